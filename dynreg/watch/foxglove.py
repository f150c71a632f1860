"""An MCAP log for Foxglove: joints and base, measured and simulated, every channel and its residual."""

from collections.abc import Iterator

import mujoco
import numpy as np

from dynreg.data.topics import Message, Motion, Topic, joint_states, mcap, topics
from dynreg.watch.frames import Frames


def log(frames: Frames) -> bytes:
    """The bytes of an MCAP file of JSON messages; the same frames give the same bytes.

    Topics: of a robot with joints /measured/joint_states and /simulated/joint_states; of one that moves about
    /measured/pose and /simulated/pose; for each channel /channels/NAME with its measured and simulated value and the
    residual.
    """
    parts = [topic for side, poses in frames.poses.items() for topic in _moved(frames, side, poses)]
    residuals = frames.residuals()
    for name, sides in frames.channels.items():
        found = {**sides, **({"residual": residuals[name]} if name in residuals else {})}
        parts.append(Topic(f"/channels/{name}", "dynreg.Channel", _messages(frames.times, found)))
    return mcap(parts)


def _moved(frames: Frames, side: str, poses: np.ndarray) -> list[Topic]:
    model = frames.model
    kinds = model.jnt_type
    # whole numbers: one of numpy's is not found among MuJoCo's own
    moving = [int(kind) for kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    hinged = np.flatnonzero(np.isin(kinds, moving)).tolist()
    names = [model.joint(j).name for j in hinged]
    angles = poses[:, model.jnt_qposadr[hinged]]
    if frames.base < 0:
        return [joint_states(f"/{side}/joint_states", names, frames.times, angles)]
    at = int(model.jnt_qposadr[frames.base])
    attitude = np.roll(poses[:, at + 3 : at + 7], -1, axis=1)  # MuJoCo's begin with w
    return topics(side, names, Motion(frames.times, angles, poses[:, at : at + 3], attitude))


def _messages(times: np.ndarray, values: dict[str, np.ndarray]) -> Iterator[Message]:
    for t, row in zip(times, np.stack([*values.values()], axis=1), strict=True):
        message = {name: v for name, v in zip(values, row.tolist(), strict=True) if np.isfinite(v)}
        if message:
            yield float(t), message

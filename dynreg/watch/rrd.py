"""A file for Rerun: the robot measured and simulated, its channels and their residuals on one timeline."""

import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dynreg.errors import UsageError
from dynreg.watch.frames import Frames

COLOURS = {"measured": [120, 126, 134, 255], "simulated": [11, 99, 206, 150]}
TIMELINE = "time"


def rrd(frames: Frames, name: str) -> bytes:
    """The bytes of an .rrd file; `name` is what the viewer calls it. UsageError where Rerun is not installed."""
    rr = _rerun()
    stream = rr.RecordingStream("dynreg", recording_id=name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        stream.save(str(path))
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for side, poses in frames.poses.items():
            _log_shapes(rr, stream, frames.model, side)
            _log_motion(rr, stream, frames, side, poses)
        for channel, sides in frames.channels.items():
            for side, values in sides.items():
                _log_scalars(rr, stream, f"channels/{channel}/{side}", frames.times, values)
        for channel, values in frames.residuals().items():
            _log_scalars(rr, stream, f"residuals/{channel}", frames.times, values)
        stream.flush()
        stream.disconnect()
        return path.read_bytes()


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise UsageError(
            "--as rerun needs the package rerun-sdk, which is not installed",
            expected="the optional part `rerun` of dynreg",
            do="run `pip install 'dynreg[rerun]'`, or choose --as foxglove",
        ) from None
    return rerun


def _log_shapes(rr: Any, stream: Any, model: mujoco.MjModel, side: str) -> None:
    for geom in range(model.ngeom):
        shape = _shape(rr, model, geom, COLOURS[side])
        if shape is not None:
            path = f"{_body(rr, model, side, int(model.geom_bodyid[geom]))}/geom_{geom}"
            w, x, y, z = model.geom_quat[geom]
            at = rr.Transform3D(translation=model.geom_pos[geom], quaternion=[x, y, z, w])
            stream.log(path, at, static=True)
            stream.log(path, shape, static=True)


def _shape(rr: Any, model: mujoco.MjModel, geom: int, colour: list[int]) -> Any:
    """One geometry in its own frame; None for a plane, which both robots share, and what Rerun has no form for."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom].tolist()
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        v, n = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        f, m = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices, faces = model.mesh_vert[v : v + n], model.mesh_face[f : f + m]
        return rr.Mesh3D(vertex_positions=vertices, triangle_indices=faces, albedo_factor=colour)
    if kind == kinds.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=[size], colors=[colour], fill_mode="solid")
    if kind == kinds.mjGEOM_SPHERE:
        return rr.Ellipsoids3D(radii=[size[0]], colors=[colour], fill_mode="solid")
    if kind == kinds.mjGEOM_ELLIPSOID:
        return rr.Ellipsoids3D(half_sizes=[size], colors=[colour], fill_mode="solid")
    if kind == kinds.mjGEOM_CYLINDER:
        return rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], colors=[colour], fill_mode="solid")
    if kind == kinds.mjGEOM_CAPSULE:  # Rerun's begins at one end, MuJoCo's lies about the middle
        low = [[0.0, 0.0, -size[1]]]
        return rr.Capsules3D(
            lengths=[2 * size[1]], radii=[size[0]], translations=low, colors=[colour], fill_mode="solid"
        )
    return None


def _log_motion(rr: Any, stream: Any, frames: Frames, side: str, poses: np.ndarray) -> None:
    known = np.isfinite(poses).all(axis=1)
    where, turned = body_poses(frames.model, poses[known])
    for body in range(1, frames.model.nbody):
        stream.send_columns(
            _body(rr, frames.model, side, body),
            indexes=[rr.TimeColumn(TIMELINE, duration=frames.times[known])],
            columns=rr.Transform3D.columns(
                translation=where[:, body], quaternion=np.roll(turned[:, body], -1, axis=1)
            ),
        )


def body_poses(model: mujoco.MjModel, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, B, 3) [m] and quaternions w, x, y, z (T, B, 4) of every body in the world, for poses (T, nq)."""
    data = mujoco.MjData(model)
    where, turned = np.empty((len(poses), model.nbody, 3)), np.empty((len(poses), model.nbody, 4))
    for t, pose in enumerate(poses):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        where[t], turned[t] = data.xpos, data.xquat
    return where, turned


def _log_scalars(rr: Any, stream: Any, path: str, times: np.ndarray, values: np.ndarray) -> None:
    known = np.isfinite(values)
    if known.any():
        stream.send_columns(
            path,
            indexes=[rr.TimeColumn(TIMELINE, duration=times[known])],
            columns=rr.Scalars.columns(scalars=values[known]),
        )


def _body(rr: Any, model: mujoco.MjModel, side: str, body: int) -> str:
    """The path of a body. A "/" in its name is no step of it: all bodies are placed in the world."""
    return f"{side}/{rr.escape_entity_path_part(model.body(body).name or f'body_{body}')}"

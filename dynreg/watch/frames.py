"""Poses of the robot as it was measured and as a simulator moves it under the same commands, on one timeline."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.names import parts_of
from dynreg.data.recording import Recording
from dynreg.replay.cut import windows
from dynreg.replay.rows import Rows, rows_of
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.layout import BASE
from dynreg.sim.robot import Robot

if TYPE_CHECKING:
    import mujoco

MEASURED, SIMULATED = "measured", "simulated"
REST = 1.0  # s that a rest between two episodes is shown at most: logs may lie hours apart


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames to view: a model, and its joints at times (T,) [s] from the beginning; long rests are cut.

    base : number of the free joint of the robot's base; -1 where it is held.
    poses : {"measured" or "simulated": (T, nq)}; joints that were not measured stay where the model has them.
    channels : {name: {"measured" or "simulated": (T,)}}, in `units`; NaN where not measured.
    """

    model: "mujoco.MjModel"
    base: int
    times: np.ndarray
    poses: Mapping[str, np.ndarray]
    channels: Mapping[str, Mapping[str, np.ndarray]]
    units: Mapping[str, str]

    def residuals(self) -> dict[str, np.ndarray]:
        """{channel: (T,) simulated less measured}, where both are there; NaN where not measured."""
        both = {n: c for n, c in self.channels.items() if len(c) == 2}
        return {name: c[SIMULATED] - c[MEASURED] for name, c in both.items()}


def frames(robot: Robot, recording: Recording, config: SimConfig, *, threads: int = 0) -> Frames:
    """A recording beside a simulator that is given its commands.

    The simulator begins anew from the measured state where a window of the replay begins, as it does when errors are
    judged. Raises LogError where the recording lacks the robot's commands.
    """
    cut, rows = windows(robot, recording), rows_of(robot, recording)
    values = robot.space.from_dict(dict(config.values))[None]
    states = rollout(robot, values, cut.run, threads=threads, terms=terms_of(config, robot)).states[0, :]
    parts, begin = [], _begins(rows)
    for w, (n, (first, stop)) in enumerate(zip(cut.episode.tolist(), cut.rows.tolist(), strict=True)):
        times = rows.time[n][first:stop] - rows.time[n][0] + begin[n]
        parts.append((times, cut.measured[w, : stop - first], states[w, : stop - first]))
    # windows share a row: it is the last of the one before
    kept = [np.concatenate(each) for each in zip(*parts, strict=True)]
    fresh = np.diff(np.maximum.accumulate(kept[0]), prepend=-1.0) > 0
    times, measured, simulated = (each[fresh] for each in kept)
    found = {MEASURED: measured, SIMULATED: simulated}
    return Frames(
        robot.model,
        robot.base,
        times,
        {side: poses(robot, values) for side, values in found.items()},
        {name: {side: v[:, i] for side, v in found.items()} for i, name in enumerate(robot.channels)},
        {c.name: c.unit for c in robot.file.channels},
    )


def _begins(rows: Rows) -> np.ndarray:
    """(E,) seconds from the first frame to that of each episode, with at most `REST` of each rest between two."""
    lengths = np.array([time[-1] - time[0] for time in rows.time])
    rests = np.diff(rows.begin) - lengths[:-1]
    return rows.begin - np.concatenate([[0.0], np.cumsum(np.maximum(rests - REST, 0.0))])


def still(robot: Robot) -> Frames:
    """A robot as its episodes begin: one pose."""
    return Frames(robot.model, robot.base, np.zeros(1), {SIMULATED: _begin(robot)[None]}, {}, {})


def poses(robot: Robot, states: np.ndarray) -> np.ndarray:
    """(T, nq) joint positions of states (T, S) by the names of the robot's channels.

    What is NaN stays as it was; what no channel tells stays where the robot begins.
    """
    model = robot.model
    out = np.tile(_begin(robot), (len(states), 1))
    joints = {model.joint(j).name: j for j in range(model.njnt)}
    angles: dict[int, dict[str, np.ndarray]] = {}
    for column, name in enumerate(robot.channels):
        owner, quantity = parts_of(name)
        if owner not in joints or quantity not in ("position", *BASE[:6]):
            continue
        at, values = int(model.jnt_qposadr[joints[owner]]), _filled(states[:, column])
        if values is None:
            continue
        if quantity in BASE[3:6]:
            angles.setdefault(at, {})[quantity] = values
        else:
            out[:, at + ("x", "y", "z", "position").index(quantity) % 3] = values
    for at, told in angles.items():
        turns = np.stack([told.get(axis, np.zeros(len(states))) for axis in ("yaw", "pitch", "roll")], axis=1)
        out[:, at + 3 : at + 7] = np.roll(Rotation.from_euler("ZYX", turns).as_quat(), 1, axis=1)
    return out


def _begin(robot: Robot) -> np.ndarray:
    model = robot.model
    return np.array(model.qpos0 if robot.keyframe < 0 else model.key_qpos[robot.keyframe])


def _filled(values: np.ndarray) -> np.ndarray | None:
    """Without gaps: each value holds until the next, the first one from the start on; None where there is none."""
    known = np.isfinite(values)
    if not known.any():
        return None
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, known.argmax(), last)]

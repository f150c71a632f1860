"""Poses of the robot as it was measured and as a simulator moves it under the same commands, on one timeline."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.clocks import begins
from dynreg.data.names import parts_of
from dynreg.data.recording import Recording
from dynreg.replay.cut import windows
from dynreg.replay.rows import Rows, rows_of
from dynreg.sim.base import base_joint
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.layout import BASE
from dynreg.sim.robot import Robot

if TYPE_CHECKING:
    import mujoco

MEASURED, SIMULATED = "measured", "simulated"
# s that a rest between two episodes is shown at most, as logs may lie hours apart; also where it is not known
REST = 1.0


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames to view: a model, and its joints at times (T,) [s] from the beginning; long rests are cut.

    base : number of the free joint of the robot's base; -1 where it is held.
    poses : {"measured" or "simulated": (T, nq)}; joints that were not measured stay where the model has them. Rows of
    "simulated" are NaN where nothing was simulated.
    channels : {name: {"measured" or "simulated": (T,)}}, in `units`; NaN where not measured or not simulated.
    """

    model: "mujoco.MjModel"
    base: int
    times: np.ndarray
    poses: Mapping[str, np.ndarray]
    channels: Mapping[str, Mapping[str, np.ndarray]]
    units: Mapping[str, str]

    def residuals(self) -> dict[str, np.ndarray]:
        """{channel: (T,) simulated less measured}, where both are there; NaN where one of them is."""
        both = {n: c for n, c in self.channels.items() if len(c) == 2}
        return {name: c[SIMULATED] - c[MEASURED] for name, c in both.items()}


def frames(robot: Robot, recording: Recording, config: SimConfig, *, threads: int = 0) -> Frames:
    """A recording beside a simulator that is given its commands.

    The simulator begins anew from the measured state where a window of the replay begins, as it does when errors are
    judged, and in what is left at the end of an episode. Where no window can begin there is the measured robot alone.
    Raises LogError where the recording lacks the robot's commands.
    """
    rows = rows_of(robot, recording)
    begin = _begins(rows)
    times = np.concatenate([time - time[0] + begin[n] for n, time in enumerate(rows.time)])
    measured = np.concatenate(rows.states)
    simulated = np.concatenate(_simulated(robot, recording, config, rows, threads))
    found = {MEASURED: measured, SIMULATED: simulated}
    moved = {side: poses(robot, values) for side, values in found.items()}
    moved[SIMULATED][np.isnan(simulated).all(axis=1)] = np.nan
    return Frames(
        robot.model,
        base_of(robot),
        times,
        moved,
        {name: {side: v[:, i] for side, v in found.items()} for i, name in enumerate(robot.channels)},
        {c.name: c.unit for c in robot.file.channels},
    )


def _simulated(
    robot: Robot, recording: Recording, config: SimConfig, rows: Rows, threads: int
) -> list[np.ndarray]:
    """States (T, S) of each episode, NaN where no window is."""
    cut = windows(robot, recording, rest=True)
    values = robot.space.from_dict(dict(config.values))[None]
    states = rollout(robot, values, cut.run, threads=threads, terms=terms_of(config, robot)).states[0, :]
    out = [np.full_like(measured, np.nan) for measured in rows.states]
    # Windows share a row, which is the last of the one before: that one is written last.
    for n, (first, stop), window in reversed([*zip(cut.episode, cut.rows, states, strict=True)]):
        out[n][first:stop] = window[: stop - first]
    return out


def _begins(rows: Rows) -> np.ndarray:
    """(E,) seconds from the first frame to that of each episode, with a row's period to `REST` between two."""
    first, last = (np.array([time[at] for time in rows.time]) for at in (0, -1))
    lengths = (last - first)[:-1]
    rests = np.clip(np.diff(begins(first, last, REST)) - lengths, rows.period, REST)
    return np.cumsum([0.0, *(lengths + rests)])


def base_of(robot: Robot) -> int:
    """Number of the free joint that shows how a robot moves about, also one whose engines move a planar base."""
    return base_joint(robot.model, robot.driven)


def still(robot: Robot) -> Frames:
    """A robot as its episodes begin: one pose."""
    return Frames(robot.model, base_of(robot), np.zeros(1), {SIMULATED: robot.start[None]}, {}, {})


def poses(robot: Robot, states: np.ndarray) -> np.ndarray:
    """(T, nq) joint positions of states (T, S) by the names of the robot's channels.

    What is NaN stays as it was; what no channel tells stays where the robot begins.
    """
    model = robot.model
    out = np.tile(robot.start, (len(states), 1))
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


def _filled(values: np.ndarray) -> np.ndarray | None:
    """Without gaps: each value holds until the next, the first one from the start on; None where there is none."""
    known = np.isfinite(values)
    if not known.any():
        return None
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(last < 0, known.argmax(), last)]

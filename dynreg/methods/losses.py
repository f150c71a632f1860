"""The losses of a staged calibration: what a simulator leaves of a recording, as one number."""

import warnings
from collections.abc import Callable

import numpy as np

from dynreg.adapt.plan import Stage
from dynreg.adapt.staged import Loss
from dynreg.data.names import quantity_of
from dynreg.errors import Assumed, UsageError
from dynreg.replay.data import Data
from dynreg.replay.residual import MOST
from dynreg.replay.velocity import pose_columns
from dynreg.replay.windows import Replayer, errors

# m/s: the most that an error of a mean velocity counts, and what a diverged simulation counts. Our choice: far beyond
# what a small robot does.
FASTEST = 10.0
SPEEDS = ("vx", "vy", "wz")  # of a floating base, in its own frame


def loss_of(stage: Stage, data: Data, replayer: Replayer) -> Loss:
    """The loss of a stage, over the windows in which something was measured behind what it skips.

    Raises UsageError for a loss that the robot's channels do not tell, and where no window is left.
    """
    return {"replay": _replayed, "joint": _joint, "velocity": _velocity}[stage.table.loss](
        stage, data, replayer
    )


def _replayed(stage: Stage, data: Data, replayer: Replayer) -> Loss:
    rows = _rows(stage, data)
    measured = data.windows.measured[stage.windows, rows:][..., data.windows.weight > 0]
    windows = _told(stage, data, np.isfinite(measured).any(axis=(1, 2)), "nothing was measured")

    def replayed(unit: np.ndarray) -> np.ndarray:
        states = replayer.states(data.values_of(unit), windows)[:, :, rows - 1 :]
        return errors(replayer.against(states, data.windows.measured[windows, rows - 1 :])).mean(axis=1)

    return Loss(replayed, MOST, windows)


def _joint(stage: Stage, data: Data, replayer: Replayer) -> Loss:
    rows, own = _rows(stage, data), _joints(data, stage)
    reach = round(stage.table.shift / data.windows.period)
    counted = data.windows.measured[stage.windows][:, rows + reach :, own]
    counted = counted[:, : counted.shape[1] - reach]
    lack = f"no joint angle was measured up to shift = {stage.table.shift:g} s before the end of a window and"
    windows = _told(stage, data, np.isfinite(counted).any(axis=(1, 2)), lack)
    measured = data.windows.measured[windows][..., own]

    def joint(unit: np.ndarray) -> np.ndarray:
        states = replayer.states(data.values_of(unit), windows)
        return joint_loss(states[..., own], measured, rows, reach)

    return Loss(joint, np.pi**2, windows)


def _velocity(stage: Stage, data: Data, replayer: Replayer) -> Loss:
    rows, weight = _rows(stage, data), np.array([1.0, 1.0, stage.table.rotation])
    try:
        velocities = mean_velocities(data)
    except UsageError as error:
        raise _untold(stage, data, error.problem, "'replay' or 'joint'") from None
    every = velocities(data.windows.measured[stage.windows, rows:])
    there = np.isfinite(every).all(axis=-1)
    windows, of_log = _told(stage, data, there, "too few poses or speeds were measured"), every[there]
    known = np.isfinite(data.windows.measured[windows, rows:])

    def velocity(unit: np.ndarray) -> np.ndarray:
        simulated = replayer.states(data.values_of(unit), windows)[:, :, rows:]
        # what was not measured counts in neither: a camera may be slow, and a log may end with a fall
        diverged = (~np.isfinite(simulated).all(axis=-1) & known.any(axis=-1)).any(axis=-1)
        apart = velocities(np.where(known, simulated, np.nan)) - of_log
        squared = np.minimum(np.nan_to_num(((weight * apart) ** 2).sum(axis=-1), nan=np.inf), FASTEST**2)
        return np.where(diverged, FASTEST**2, squared).mean(axis=1)

    return Loss(velocity, FASTEST**2, windows)


def joint_loss(simulated: np.ndarray, measured: np.ndarray, skip: int, reach: int) -> np.ndarray:
    """(n,) mean squares [rad^2] of joint angles (n, W, T, J) less measured ones (W, T, J), from row `skip` on.

    The log may be up to `reach` rows later or earlier than the simulation: of each simulator the best counts, one for
    all windows (paper E). The same rows of the log count for every shift, and one of them must be measured. A row
    counts at most pi^2, and so does each of a simulation that diverged.
    """
    first, last = skip + reach, simulated.shape[2] - reach
    known, out = np.isfinite(measured[:, first:last]), []
    for late in range(-reach, reach + 1):
        with np.errstate(invalid="ignore", over="ignore"):
            apart = simulated[:, :, first - late : last - late] - measured[:, first:last]
        squared = np.where(np.isfinite(apart), np.minimum(apart**2, np.pi**2), np.pi**2)
        out.append(np.where(known, squared, 0.0).sum(axis=(1, 2, 3)) / known.sum())
    return np.min(out, axis=0)


def _told(stage: Stage, data: Data, there: np.ndarray, lack: str) -> np.ndarray:
    """Numbers of the stage's windows in which something counts (W',): a log may end before, as by a fall.

    Raises UsageError, with what they lack, where nothing does in any.
    """
    if not there.any():
        name = data.recording.episodes[data.windows.episode[stage.windows[0]]].name
        raise UsageError(
            f"stage {stage.table.name!r}: {lack} behind skip = {stage.table.skip:g} s, as in {name!r}",
            expected="a recording that lasts longer, or in which more is measured",
            do="lower skip and shift, or choose another loss",
        )
    return stage.windows[there]


def _rows(stage: Stage, data: Data) -> int:
    """The first row of a window that counts. Raises UsageError where none is left to count."""
    table, period = stage.table, data.windows.period
    first = max(round(table.skip / period), 1)
    reach = 2 * round(table.shift / period) if table.loss == "joint" else 0
    length = data.windows.measured.shape[1]
    if first + reach + 1 >= length:
        raise UsageError(
            f"stage {table.name!r}: skip = {table.skip:g} s and shift = {table.shift:g} s",
            expected=f"less than a window, {(length - 1) * period:.3g} s",
            do="skip less, or raise `horizon` of [replay] in robot.toml",
        )
    return first


def _joints(data: Data, stage: Stage) -> np.ndarray:
    """Columns of the joints' angles that are scored. Warns of joints that slide, which are left out."""
    robot = data.robot
    scored = [
        i for i, c in enumerate(robot.file.channels) if quantity_of(c.name) == "position" and c.weight > 0
    ]
    own = [i for i in scored if robot.file.channels[i].unit == "rad"]
    if not own or robot.planar:
        raise _untold(stage, data, "no channel of a joint's angle", "'replay' or 'velocity'")
    if others := [robot.channels[i] for i in scored if i not in own]:
        scores = f"stage {stage.table.name!r}: loss 'joint' scores angles and leaves out {', '.join(others)}"
        warnings.warn(f"{scores}; loss 'replay' counts them", Assumed, 2)
    return np.array(own)


def _untold(stage: Stage, data: Data, lack: str, other: str) -> UsageError:
    table = stage.table
    return UsageError(
        f"{table.place('loss')}stage {table.name!r}: loss {table.loss!r} of {data.robot.name!r}, which has {lack}",
        expected=other,
        do="choose one of these",
    )


def mean_velocities(data: Data) -> Callable[[np.ndarray], np.ndarray]:
    """(..., 3) mean velocity ahead, to the left [m/s] and yaw rate [rad/s] of states (..., T, S).

    A pose needs two measured rows to tell any. What is not measured is NaN, and so is a mean of nothing.

    Raises UsageError for a robot whose channels tell none.
    """
    robot, period = data.robot, data.windows.period
    pose = pose_columns(robot)
    if pose is not None:
        return lambda states: _from_poses(states[..., pose], period)
    columns = [[i for i, c in enumerate(robot.channels) if quantity_of(c) == q] for q in SPEEDS]
    if not all(len(found) == 1 for found in columns):
        raise UsageError(
            f"a base without channels {', '.join(SPEEDS)}",
            expected="a robot whose base is measured",
            do="add them to robot.toml",
        )
    own = np.array([found[0] for found in columns])

    def means(states: np.ndarray) -> np.ndarray:
        speeds = states[..., own]
        known = np.isfinite(speeds)
        with np.errstate(invalid="ignore"):
            return np.where(known, speeds, 0.0).sum(axis=-2) / known.sum(axis=-2)

    return means


def _from_poses(pose: np.ndarray, period: float) -> np.ndarray:
    """(..., 3) of poses (..., T, 3): steps from one measured pose to the next, each turned to the heading before it."""
    known = np.isfinite(pose).all(axis=-1)
    last = np.maximum.accumulate(np.where(known, np.arange(pose.shape[-2]), -1), axis=-1)
    before = np.concatenate([np.full_like(last[..., :1], -1), last[..., :-1]], axis=-1)
    stepped = known & (before >= 0)
    then = np.take_along_axis(pose, np.maximum(before, 0)[..., None], axis=-2)
    step, heading = np.where(stepped[..., None], pose - then, 0.0), np.where(stepped, then[..., 2], 0.0)
    ahead = np.cos(heading) * step[..., 0] + np.sin(heading) * step[..., 1]
    left = np.cos(heading) * step[..., 1] - np.sin(heading) * step[..., 0]
    turn = np.arctan2(np.sin(step[..., 2]), np.cos(step[..., 2]))
    rows = np.where(stepped, np.arange(pose.shape[-2]) - before, 0).sum(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.stack([ahead, left, turn], axis=-1).sum(axis=-2) / (rows * period)[..., None]

"""The losses of a staged calibration: what a simulator leaves of a recording, as one number."""

from collections.abc import Callable

import numpy as np

from dynreg.adapt.plan import Stage
from dynreg.adapt.staged import Loss
from dynreg.data.names import quantity_of
from dynreg.errors import UsageError
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
    table, rows = stage.table, _rows(stage, data)
    windows = _measured(stage, data, rows)
    measured = data.windows.measured[windows]

    def replayed(unit: np.ndarray) -> np.ndarray:
        residual = replayer.residuals(data.values_of(unit), windows)
        return errors(residual[:, :, rows - 1 :]).mean(axis=1)

    def states(unit: np.ndarray) -> np.ndarray:
        return replayer.states(data.values_of(unit), windows)

    if table.loss == "replay":
        return Loss(replayed, MOST)
    if table.loss == "joint":
        own = _joints(data, stage)
        reach = round(table.shift / data.windows.period)
        return Loss(
            lambda unit: joint_loss(states(unit)[..., own], measured[..., own], rows, reach), np.pi**2
        )
    try:
        velocities = mean_velocities(data)
    except UsageError as error:
        raise _untold(stage, data, error.problem, "'replay' or 'joint'") from None
    weight, of_log = np.array([1.0, 1.0, table.rotation]), velocities(measured[:, rows:])

    def velocity(unit: np.ndarray) -> np.ndarray:
        simulated = states(unit)[:, :, rows:]
        # of a log that ends with a fall, both count until then
        over = ~np.isfinite(measured[:, rows:]).any(axis=-1)
        diverged = (~np.isfinite(simulated).all(axis=-1) & ~over).any(axis=-1)
        apart = velocities(np.where(over[..., None], np.nan, simulated)) - of_log
        squared = np.minimum(np.nan_to_num(((weight * apart) ** 2).sum(axis=-1), nan=np.inf), FASTEST**2)
        return np.where(diverged, FASTEST**2, squared).mean(axis=1)

    return Loss(velocity, FASTEST**2)


def joint_loss(simulated: np.ndarray, measured: np.ndarray, skip: int, reach: int) -> np.ndarray:
    """(n,) mean squares [rad^2] of joint angles (n, W, T, J) less measured ones (W, T, J), from row `skip` on.

    The log may be up to `reach` rows later or earlier than the simulation: of each simulator the best counts, one for
    all windows (paper E). A row counts at most pi^2, and so does each of a simulation that diverged.
    """
    first, last = skip + reach, simulated.shape[2] - reach
    out = []
    for late in range(-reach, reach + 1):
        with np.errstate(invalid="ignore", over="ignore"):
            apart = simulated[:, :, first:last] - measured[:, first + late : last + late]
        known = np.isfinite(measured[:, first + late : last + late])
        squared = np.where(np.isfinite(apart), np.minimum(apart**2, np.pi**2), np.pi**2)
        out.append((squared * known).sum(axis=(1, 2, 3)) / max(known.sum(), 1))
    return np.min(out, axis=0)


def _measured(stage: Stage, data: Data, rows: int) -> np.ndarray:
    """Numbers of the stage's windows with a measured state from row `rows` on: a log may end before, as by a fall."""
    scored = data.windows.weight > 0
    there = np.isfinite(data.windows.measured[stage.windows, rows:][..., scored]).any(axis=(1, 2))
    if not there.any():
        name = data.recording.episodes[data.windows.episode[stage.windows[0]]].name
        raise UsageError(
            f"stage {stage.table.name!r}: nothing was measured behind skip = {stage.table.skip:g} s, as in {name!r}",
            expected="a recording that lasts longer",
            do="skip less",
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
    own = [i for i, name in enumerate(data.robot.channels) if quantity_of(name) == "position"]
    if not own or data.robot.planar:
        raise _untold(stage, data, "no channel of a joint's position", "'replay' or 'velocity'")
    return np.array(own)


def _untold(stage: Stage, data: Data, lack: str, other: str) -> UsageError:
    table = stage.table
    return UsageError(
        f"stage {table.name!r}: loss {table.loss!r} of {data.robot.name!r}, which has {lack}",
        expected=other,
        do="choose one of these",
    )


def mean_velocities(data: Data) -> Callable[[np.ndarray], np.ndarray]:
    """(..., 3) mean velocity ahead, to the left [m/s] and yaw rate [rad/s] of states (..., T, S).

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
    return lambda states: np.nanmean(states[..., own], axis=-2)


def _from_poses(pose: np.ndarray, period: float) -> np.ndarray:
    """(..., 3) of poses (..., T, 3): the mean of steps, each turned to the heading in which it begins."""
    step = np.diff(pose, axis=-2)
    heading = pose[..., :-1, 2]
    ahead = np.cos(heading) * step[..., 0] + np.sin(heading) * step[..., 1]
    left = np.cos(heading) * step[..., 1] - np.sin(heading) * step[..., 0]
    turn = np.arctan2(np.sin(step[..., 2]), np.cos(step[..., 2]))
    return np.nanmean(np.stack([ahead, left, turn], axis=-1), axis=-2) / period

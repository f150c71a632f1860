"""Baselines that take no simulator: a robot that holds still, and joints that simply follow their commands.

An error that is no smaller than theirs says that a simulator predicts nothing; a gain over a simulator that is worse
than they are is no gain.
"""

from collections.abc import Sequence

import numpy as np

from dynreg.replay.windows import Windows, follows
from dynreg.sim.robot import Robot

# Time constants [s] of the lag with which a joint follows: from none to that of a drive that hardly moves.
LAGS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def held(robot: Robot, windows: Windows) -> np.ndarray:
    """(W, T+1, S) what is measured first in each window for as long as it lasts, and no speeds."""
    out = np.repeat(_first(windows), windows.measured.shape[1], axis=1)
    speeds = [c for c, channel in enumerate(robot.file.channels) if channel.unit.endswith("/s")]
    out[..., speeds] = 0.0
    return out


def followed(robot: Robot, windows: Windows, chosen: Sequence[int]) -> np.ndarray:
    """(W, T+1, S) positions of joints that follow their commands with a lag of first order; NaN in other channels.

    The time constant of each joint is that of `LAGS` with the least error in the windows `chosen`. Only drives that
    are told positions have such channels.
    """
    out = np.full(windows.measured.shape, np.nan)
    low, high = robot.action_ranges.T
    commands = np.clip(windows.run.actions, low, high)
    for action, column in follows(robot):
        measured = windows.measured[..., column]
        if not np.isfinite(measured[chosen]).any():
            continue
        made = [
            _lagged(_first(windows)[:, 0, column], commands[..., action], lag, windows.period) for lag in LAGS
        ]
        missed = [np.nanmean(np.abs(one[chosen] - measured[chosen])) for one in made]
        out[..., column] = made[int(np.argmin(missed))]
    return out


def _first(windows: Windows) -> np.ndarray:
    """(W, 1, S) the first value of each channel that was measured in each window: not all may be at its start."""
    at = np.isfinite(windows.measured).argmax(axis=1)[:, None]
    return np.take_along_axis(windows.measured, at, axis=1)


def _lagged(start: np.ndarray, commands: np.ndarray, lag: float, period: float) -> np.ndarray:
    """(W, T+1) from starts (W,) towards commands (W, T); at once without a lag."""
    share = 1.0 if lag == 0 else 1.0 - np.exp(-period / lag)
    rows = [start]
    for command in commands.T:
        rows.append(rows[-1] + share * (command - rows[-1]))
    return np.stack(rows, axis=1)

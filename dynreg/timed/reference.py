"""What a robot was: the unicycle with a gain of each wheel and of its turns, from the commands of one recording."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from dynreg.timed.commands import Commands
from dynreg.timed.unicycle import unicycle

STEP = 0.02  # s, of the simulation; a lag that is shorter is none
FITTED = 2000  # commands at most
WIDTH = 0.5  # 1 sigma of a gain's logarithm before any data: what they say nothing of stays nominal
FARTHEST = 1.5  # the largest logarithm of a factor


@dataclass(frozen=True, eq=False)
class Reference:
    """The unicycle with six parameters (6,), the wheels `track` [m] apart.

    left, right, turns : factors on what a wheel is told and on the yaw rate.
    """

    parameters: np.ndarray
    track: float
    left: float = 1.0
    right: float = 1.0
    turns: float = 1.0

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements [m, m, rad] of commands (n,)."""
        left, right, seconds, left_before, right_before = commands.columns
        told = Commands(
            self.left * left, self.right * right, seconds, self.left * left_before, self.right * right_before
        )
        still = np.maximum(self.parameters, [STEP, STEP, -np.inf, -np.inf, -np.inf, -np.inf])
        return unicycle(told, still, self.track / self.turns, step=STEP)

    def changed(self, pattern: str, factor: float) -> "Reference":
        """The robot once a pattern of `patterns.PATTERNS` holds."""
        left = factor if pattern in ("left wheel", "all speeds") else 1.0
        right = factor if pattern in ("right wheel", "all speeds") else 1.0
        turns = factor if pattern == "turns only" else 1.0
        return replace(self, left=left * self.left, right=right * self.right, turns=turns * self.turns)


def on_the_way(commands: Commands, episode: np.ndarray, reference: Reference) -> Commands:
    """Commands (n,) in the order in which they were given, each beginning with the speeds that the lags left.

    A short command ends before the robot does what it says; the speeds told are no good begin for the next one. Where
    a command does not follow the one before it in the same episode (n,), what was told before stays.
    """
    speed_lag, yaw_lag = np.maximum(reference.parameters[:2], STEP)
    speed_drag, yaw_drag = reference.parameters[[3, 5]]
    left, right, seconds, left_before, right_before = (column.copy() for column in commands.columns)
    follows = np.zeros(len(commands), dtype=bool)
    follows[1:] = (
        (episode[1:] == episode[:-1])
        & (commands.left_before[1:] == commands.left[:-1])
        & (commands.right_before[1:] == commands.right[:-1])
    )
    speed = yaw = 0.0
    for i in range(len(commands)):
        if not follows[i]:
            speed = 0.5 * (left_before[i] + right_before[i])
            yaw = (right_before[i] - left_before[i]) / reference.track
        left_before[i] = speed - 0.5 * reference.track * yaw
        right_before[i] = speed + 0.5 * reference.track * yaw
        end = 0.5 * (left[i] + right[i]) / speed_drag
        speed = end + (speed - end) * np.exp(-speed_drag * seconds[i] / speed_lag)
        end = (right[i] - left[i]) / reference.track / yaw_drag
        yaw = end + (yaw - end) * np.exp(-yaw_drag * seconds[i] / yaw_lag)
    return Commands(left, right, seconds, left_before, right_before)


def fitted(nominal: Reference, commands: Commands, moved: np.ndarray, rng: np.random.Generator) -> Reference:
    """The gains and the two lags that explain displacements (n, 3) of commands (n,) best, near the nominal ones.

    At most `FITTED` commands, drawn by `rng`, count.
    """
    if len(commands) > FITTED:
        some = np.sort(rng.choice(len(commands), FITTED, replace=False))
        commands, moved = commands.take(some), moved[some]
    off = moved - nominal.predict(commands)
    scale = np.maximum(1.4826 * np.median(np.abs(off - np.median(off, axis=0)), axis=0), 1e-6)

    def residuals(x: np.ndarray) -> np.ndarray:
        apart = (_with(nominal, x).predict(commands) - moved) / scale
        return np.concatenate([apart.ravel(), x / WIDTH])

    found = least_squares(residuals, np.zeros(5), bounds=(-FARTHEST, FARTHEST), loss="soft_l1", x_scale=0.1)
    return _with(nominal, found.x)


def _with(nominal: Reference, x: np.ndarray) -> Reference:
    """With gains and lags whose logarithms (5,), over the nominal ones, are `x`."""
    left, right, turns = np.exp(x[:3])
    parameters = nominal.parameters.copy()
    parameters[:2] *= np.exp(x[3:])
    return replace(nominal, parameters=parameters, left=left, right=right, turns=turns)

"""The displacement table as a predictor: the closed form, put right in each cell of wheel speeds by what was measured.

The table of paper C holds what commands of one length moved. Commands last as long as they like here: a cell holds by
how much the velocity and the yaw rate were off, and a command moves with both over its own time. Like the paper's table
it does not know what was told before.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.timed.cells import Grid
from dynreg.timed.commands import Commands

SIZES = (1, 2, 3, 5, 10, 20)  # cells for each wheel; the paper has 20
TINY = 1e-9  # rad: a turn through less is none
FINE = np.array([1e-4, 1e-4, 1e-3])  # m, m, rad: what validates to this is as good
LEAST = 1e-6  # m/s between the slowest and the fastest wheel: the same is told all the time


@dataclass(frozen=True, eq=False)
class Cellwise:
    """Velocities (cells,) ahead + i to the left [m/s] and yaw rates (cells,) [rad/s] beyond the closed form's.

    Cells without a sample, and commands outside of all, are the closed form's; the wheels are `track` [m] apart.
    """

    grid: Grid
    velocity: np.ndarray
    turning: np.ndarray
    track: float

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""
        cell = self.grid.cell(commands.left, commands.right)
        velocity, turning = _told(commands, self.track)
        velocity = velocity + np.where(cell >= 0, self.velocity[cell], 0.0)
        angle = commands.seconds * (turning + np.where(cell >= 0, self.turning[cell], 0.0))
        way = velocity * _turned(angle) * commands.seconds
        return np.stack([-way.imag, way.real, angle], axis=1)


def fit_cellwise(
    commands: Commands, moved: np.ndarray, validation: tuple[Commands, np.ndarray], track: float
) -> Cellwise:
    """By least squares in each cell, from commands (n,) and displacements (n, 3); as many cells as validate best.

    validation : the same of others; errors are in units of each axis' standard deviation.
    """
    unseen, wanted = validation
    spread = np.maximum(wanted.std(axis=0), FINE)
    speeds = np.concatenate([commands.left, commands.right])
    tried = []
    for each in SIZES:
        grid = Grid(float(speeds.min()), float(max(speeds.max(), speeds.min() + LEAST)), each)
        tried.append(_fitted(grid, commands, moved, track))
    apart = [float(np.mean(((t.predict(unseen) - wanted) / spread) ** 2)) for t in tried]
    return tried[int(np.argmin(apart))]


def _fitted(grid: Grid, commands: Commands, moved: np.ndarray, track: float) -> Cellwise:
    cell, seconds = grid.cell(commands.left, commands.right), commands.seconds
    velocity, turning = _told(commands, track)
    unit = _turned(moved[:, 2]) * seconds  # the way at 1 m/s, as the robot turned
    off = moved[:, 1] - 1j * moved[:, 0] - velocity * unit
    late = moved[:, 2] - turning * seconds

    def over(values: np.ndarray) -> np.ndarray:
        return np.bincount(cell, values, grid.cells)

    ways, times = over(np.abs(unit) ** 2), over(seconds**2)
    there = (np.conj(unit) * off).real, (np.conj(unit) * off).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = (over(there[0]) + 1j * over(there[1])) / ways
        return Cellwise(grid, _known(beside), _known(over(seconds * late) / times), track)


def _told(commands: Commands, track: float) -> tuple[np.ndarray, np.ndarray]:
    """(n,) velocities ahead [m/s] and yaw rates [rad/s]."""
    return 0.5 * (commands.left + commands.right), (commands.right - commands.left) / track


def _turned(angle: np.ndarray) -> np.ndarray:
    """(n,) the mean of e^(i a) for a from 0 to angles (n,): where a unit of way ahead leads."""
    still = np.abs(angle) < TINY
    a = np.where(still, 1.0, angle)
    return np.where(still, 1.0, (np.exp(1j * a) - 1.0) / (1j * a))


def _known(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, 0.0)

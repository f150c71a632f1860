"""Drives in cells of wheel speeds: what each moved less what a reference predicts of its own commands."""

from dataclasses import dataclass

import numpy as np

from dynreg.errors import UsageError
from dynreg.timed.commands import AXES, Commands
from dynreg.timed.table import DisplacementTable

NEAR = 0.2  # share of its time by which a piece may be longer or shorter


@dataclass(frozen=True)
class Grid:
    """`each` x `each` cells of wheel speeds, both wheels from `low` to `high` [m/s]."""

    low: float
    high: float
    each: int

    def __post_init__(self):
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high and self.each >= 1):
            raise UsageError(
                f"{self.each} x {self.each} cells from {self.low:g} to {self.high:g} m/s",
                expected="one cell or more between two speeds",
                do="ask for more cells, or take a recording in which the wheels are told to turn",
            )

    @property
    def cells(self) -> int:
        """How many there are."""
        return self.each**2

    def cell(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(n,) numbers of the cells of speeds (n,) [m/s], the right wheel's the faster one; -1 outside of them."""
        inside = np.logical_and.reduce([(side >= self.low) & (side <= self.high) for side in (left, right)])
        share = [(side - self.low) / (self.high - self.low) for side in (left, right)]
        at = [np.minimum(np.floor(self.each * s), self.each - 1) for s in share]  # the fastest is in the last
        return np.where(inside, self.each * at[0] + at[1], -1).astype(int)

    def middle(self, cell: np.ndarray) -> np.ndarray:
        """(n, 2) speeds [m/s] of the left and right wheel in the middle of cells (n,)."""
        return self.low + (np.stack(np.divmod(cell, self.each), axis=-1) + 0.5) * (
            (self.high - self.low) / self.each
        )


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of commands, about equally long, in the cells of a grid.

    commands (n,), what they moved (n, 3) [m, m, rad], their cells (n,) and the number of the drive (n,) that each is
    a part of: a command, held. episode : (drives,) of each. short, long, outside : pieces that were left out.
    """

    commands: Commands
    moved: np.ndarray
    cell: np.ndarray
    drive: np.ndarray
    episode: np.ndarray
    short: int
    long: int
    outside: int

    @property
    def drives(self) -> int:
        """How many commands were held."""
        return len(self.episode)

    def by_drive(self, values: np.ndarray) -> np.ndarray:
        """(drives, 3) means of values (n, 3) over the pieces of each drive."""
        return mean_by_cell(self.drives, self.drive, values)

    @property
    def cell_of_drive(self) -> np.ndarray:
        """(drives,) the cell of each drive."""
        out = np.zeros(self.drives, dtype=int)
        out[self.drive] = self.cell
        return out

    def table(self, grid: Grid, off: np.ndarray) -> DisplacementTable:
        """One sample for each drive of values (n, 3) of the pieces.

        Pieces of one drive share poses and the command's place within its cell: they are no independent samples, and
        tests of them do not keep their level (of robots that stayed as they were, 1.9 % at 5 %; of drives 4.1 %).
        """
        return DisplacementTable.of(grid.cells, self.cell_of_drive, self.by_drive(off))


def pieces(
    commands: Commands, moved: np.ndarray, episode: np.ndarray, grid: Grid, sample: float, asked: Commands
) -> Pieces:
    """Those of commands (n,) that last about `sample` [s] and lie in the grid.

    moved : (n, 3). episode : (n,). asked : the same commands as they were told, where `commands` begin with the speeds
    that the robot had: a drive is as long as what was told stays the same. Commands may be missing in between: one is
    of the drive before it only where the same was told before it, too.
    """
    cell = grid.cell(asked.left, asked.right)
    short = asked.seconds < (1.0 - NEAR) * sample
    long = asked.seconds > (1.0 + NEAR) * sample
    outside = ~short & ~long & (cell < 0)
    use = ~short & ~long & ~outside
    same = np.zeros(len(asked), dtype=bool)
    same[1:] = (
        (episode[1:] == episode[:-1])
        & (asked.left[1:] == asked.left[:-1])
        & (asked.right[1:] == asked.right[:-1])
        & (asked.left_before[1:] == asked.left[1:])
        & (asked.right_before[1:] == asked.right[1:])
    )
    held = np.cumsum(~same)[use]
    first, drive = np.unique(held, return_index=True, return_inverse=True)[1:]
    return Pieces(
        commands.take(use),
        moved[use],
        cell[use],
        drive,
        episode[use][first],
        int(short.sum()),
        int(long.sum()),
        int(outside.sum()),
    )


def mean_by_cell(cells: int, cell: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(cells, 3) means of values (n, 3) in cells (n,); NaN where there are none."""
    count = np.bincount(cell, minlength=cells).astype(float)
    sums = np.stack([np.bincount(cell, values[:, axis], cells) for axis in range(len(AXES))], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return sums / count[:, None]

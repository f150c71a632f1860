"""A gait for each of many goals, which lie on a grid, and for all that lie between them.

Paper B solves a kick at 30 points: where the ball lies and where it is to go. What is left unsolved is filled from its
neighbours, and what lies between the points is interpolated (trilinearly, of three axes).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from dynreg.errors import NoMatchError, UsageError


@dataclass(frozen=True, eq=False)
class Goals:
    """Points of a grid, and the gait of each.

    axes : the values on each axis, rising, two or more. gaits : (n_1, ..., n_k, G), NaN where a point is not solved.
    Raises UsageError where they do not fit each other.
    """

    axes: tuple[np.ndarray, ...]
    gaits: np.ndarray

    def __post_init__(self) -> None:
        shape = tuple(len(axis) for axis in self.axes)
        rising = all(len(axis) > 1 and (np.diff(axis) > 0.0).all() for axis in self.axes)
        if not rising or self.gaits.shape[:-1] != shape:
            raise UsageError(
                f"a grid of {shape} goals with gaits of shape {self.gaits.shape}",
                expected="two or more rising values on each axis, and a gait for each point",
                do="correct them",
            )

    @property
    def solved(self) -> np.ndarray:
        """(n_1, ..., n_k) which points have a gait."""
        return np.isfinite(self.gaits).all(axis=-1)

    def filled(self) -> "Goals":
        """Each point that is not solved has the mean of its neighbours that are, the nearest ones first.

        Raises NoMatchError where none is solved.
        """
        if not self.solved.any():
            raise NoMatchError(
                "no goal is solved", expected="one or more", do="solve one before others are filled from it"
            )
        gaits = self.gaits.copy()
        while not (done := np.isfinite(gaits).all(axis=-1)).all():
            before = gaits.copy()
            for point in map(tuple, np.argwhere(~done)):
                near = [before[one] for one in neighbours(done.shape, point) if done[one]]
                if near:
                    gaits[point] = np.mean(near, axis=0)
        return Goals(self.axes, gaits)

    def at(self, goal: Sequence[float]) -> np.ndarray:
        """(G,) the gait of a goal anywhere in the grid, linear in each coordinate between the points around it.

        NaN where one of these is not solved. Raises UsageError outside the grid.
        """
        low, share = zip(*(_cell(axis, x) for axis, x in zip(self.axes, goal, strict=True)), strict=True)
        out = np.zeros(self.gaits.shape[-1])
        for corner in product((0, 1), repeat=len(low)):
            weight = np.prod([s if up else 1.0 - s for up, s in zip(corner, share, strict=True)])
            if weight > 0.0:
                out += weight * self.gaits[tuple(i + up for i, up in zip(low, corner, strict=True))]
        return out


def neighbours(shape: tuple[int, ...], point: tuple[int, ...]) -> list[tuple[int, ...]]:
    """The points of a grid that are one step along one axis from a point."""
    around = [
        (*point[:axis], point[axis] + step, *point[axis + 1 :])
        for axis in range(len(shape))
        for step in (-1, 1)
    ]
    return [one for one in around if all(0 <= i < n for i, n in zip(one, shape, strict=True))]


def _cell(axis: np.ndarray, x: float) -> tuple[int, float]:
    """The value of the axis below x (its number), and how far x is on the way to the next one, from 0 to 1."""
    if not axis[0] <= x <= axis[-1]:
        raise UsageError(
            f"goal {x:g} outside the grid", expected=f"{axis[0]:g} to {axis[-1]:g}", do="choose one inside"
        )
    low = min(int(np.searchsorted(axis, x, side="right")) - 1, len(axis) - 2)
    return low, float((x - axis[low]) / (axis[low + 1] - axis[low]))

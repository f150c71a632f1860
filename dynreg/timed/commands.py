"""Timed commands of a robot with two driven wheels, and the displacements that they bring."""

from dataclasses import dataclass

import numpy as np

AXES = (
    "dx",
    "dy",
    "dtheta",
)  # to the right [m], ahead [m], turned to the left [rad]; as the robot stood before
FINE = np.array([1e-5, 1e-5, 1e-4])  # m, m, rad: the least scatter of a displacement; less is rounding


@dataclass(frozen=True, eq=False)
class Commands:
    """n commands: wheel speeds [m/s] that are held for a time [s], and those that were held before.

    left, right, seconds, left_before, right_before : (n,)
    """

    left: np.ndarray
    right: np.ndarray
    seconds: np.ndarray
    left_before: np.ndarray
    right_before: np.ndarray

    def __len__(self) -> int:
        return len(self.left)

    @property
    def table(self) -> np.ndarray:
        """(n, 5) left, right, left before, right before [m/s], time [s]: what a network is told."""
        return np.stack([self.left, self.right, self.left_before, self.right_before, self.seconds], axis=1)

    def take(self, which: np.ndarray) -> "Commands":
        """Some of them (indexes, a mask or a slice)."""
        return Commands(*(column[which] for column in self.columns))

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """The five, (n,) each, in the order of the fields."""
        return self.left, self.right, self.seconds, self.left_before, self.right_before


def in_a_row(left: np.ndarray, right: np.ndarray, seconds: np.ndarray) -> Commands:
    """Commands (n,) that follow each other, from standstill."""
    before = [np.concatenate([[0.0], side[:-1]]) for side in (left, right)]
    return Commands(left, right, seconds, *before)


def drawn(
    many: int, rng: np.random.Generator, *, speed: float = 0.22, seconds: tuple[float, float] = (0.1, 2.0)
) -> Commands:
    """Uniform draws that follow each other: each wheel within +-`speed` [m/s], times within `seconds` [s].

    The ranges give the displacements that the paper publishes: its own are not stated (Pretorius et al., Table III).
    """
    sides = rng.uniform(-speed, speed, (2, many))
    return in_a_row(*sides, rng.uniform(*seconds, many))


def pose_after(pose: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(..., 3) x [m], y [m], heading [rad] after displacements (..., 3) from poses (..., 3).

    Heading 0 looks along x; a displacement's own axes are to the right and ahead.
    """
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    right, ahead = moved[..., 0], moved[..., 1]
    return np.stack(
        [
            pose[..., 0] + ahead * cos + right * sin,
            pose[..., 1] + ahead * sin - right * cos,
            pose[..., 2] + moved[..., 2],
        ],
        axis=-1,
    )


def displacement(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n, 3) to the right, ahead and turned, from poses (n, 3) to poses (n, 3): the inverse of `pose_after`."""
    apart = end - begin
    cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    right = sin * apart[:, 0] - cos * apart[:, 1]
    ahead = cos * apart[:, 0] + sin * apart[:, 1]
    return np.stack([right, ahead, apart[:, 2]], axis=1)


def chained(moved: np.ndarray, pose: np.ndarray | None = None) -> np.ndarray:
    """(..., n + 1, 3) poses along displacements (..., n, 3) in a row, from `pose` (3,) or the origin."""
    out = np.zeros((*moved.shape[:-2], moved.shape[-2] + 1, 3))
    out[..., 0, :] = 0.0 if pose is None else pose
    for i in range(moved.shape[-2]):
        out[..., i + 1, :] = pose_after(out[..., i, :], moved[..., i, :])
    return out

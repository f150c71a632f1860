"""What the joints are told, as a table: all that is needed to play a gait, whatever its family."""

from dataclasses import dataclass

import numpy as np


def faded(moving: np.ndarray, rest: np.ndarray, ramp: float, times: np.ndarray) -> np.ndarray:
    """(..., T, A) joint angles [rad] at times (T,) [s] that go from rest (A,) into a motion (..., T, A).

    ramp : time [s] that it takes.
    """
    begun = np.clip(times / ramp, 0.0, 1.0)[:, None]
    return rest + begun * (moving - rest)


@dataclass(frozen=True, eq=False)
class JointTable:
    """Joint angles (K, A) [rad] at times (K,) [s] from 0, evenly in between.

    period : the last time, after which it begins again [s]; None of a motion that ends and holds its last angles.
    """

    period: float | None
    times: np.ndarray
    targets: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """(T, A) at times (T,)."""
        at = np.asarray(times) if self.period is None else np.mod(times, self.period)
        return np.stack([np.interp(at, self.times, column) for column in self.targets.T], axis=1)

    def rates(self) -> np.ndarray:
        """(K-1, A) [rad/s] between the times."""
        return np.diff(self.targets, axis=0) / np.diff(self.times)[:, None]

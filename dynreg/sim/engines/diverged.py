"""When a simulation has left the numbers that a robot can have: one bound for all engines with forces."""

import numpy as np

DIVERGED = 1e4  # rad/s or m/s: our choice, far beyond what any robot reaches


def too_fast(speeds: np.ndarray) -> np.ndarray:
    """(...) whether speeds (..., V) are beyond all bounds, or no numbers."""
    return ~(np.abs(speeds).max(axis=-1, initial=0.0) < DIVERGED)


def diverged(speeds: np.ndarray) -> np.ndarray:
    """(n, T) whether speeds (n, T, V) have left all bounds by then."""
    return np.maximum.accumulate(too_fast(speeds), axis=1)

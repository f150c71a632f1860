"""What a simulator leaves of the motion: its scale, its bound, and what a diverged simulation counts as."""

import numpy as np

MOST = 10.0  # times the motion: the most that any residual counts, and what a diverged simulation does


def scaled(
    simulated: np.ndarray, measured: np.ndarray, spread: np.ndarray, correction: np.ndarray | None = None
) -> np.ndarray:
    """(..., C) simulated less measured (..., C), in units of the channels' spread (C,); NaN where not measured.

    correction : added to it, in those units.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        residual = (simulated - measured) / spread
    if correction is not None:
        residual += correction
    residual[~np.isfinite(residual) & np.isfinite(measured)] = MOST
    return np.clip(residual, -MOST, MOST, out=residual)

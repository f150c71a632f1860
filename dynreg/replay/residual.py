"""What a simulator leaves of the motion: its scale, its bound, and what a diverged simulation counts as."""

import numpy as np

MOST = 10.0  # times the motion: the most that any residual counts, and what a diverged simulation does


def missed(simulated: np.ndarray, measured: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(..., C) size of simulated less measured (..., C), in the channels' units; NaN where not measured.

    A diverged simulation counts as in `scaled`: left out, it would look better than one with large errors. What did not
    diverge has no bound here.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        out = np.abs(simulated - measured)
    return np.where(~np.isfinite(out) & np.isfinite(measured), MOST * spread, out)


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


def by_weight(measured: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(..., C) by what the residuals of rows `measured` (..., T, C) count in a replay error, by channels' weight (C,).

    They are 1 on average over what was measured: each value counts by its channel's weight, however many each has.
    """
    rows = np.isfinite(measured).sum(axis=-2)
    many = (rows * (weight > 0)).sum(axis=-1, keepdims=True)
    return weight * many / np.maximum((rows @ weight)[..., None], 1e-300)

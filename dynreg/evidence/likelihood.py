"""The likelihood of residuals whose size is unknown, its curvature, and the posterior that a fit climbs."""

import warnings
from collections.abc import Sequence

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.point import Point

# Half and twice name the same, with 2664 and 2624 nats for 2646 (bench_constants).
FLOOR = 0.25  # of the stated sensor noise variance: no residual counts as smaller


def mean_squares(residuals: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """(n, W, C) mean squared residual of every window and channel, on top of a share of the stated noise."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel that one window does not have
        return np.nanmean(residuals**2, axis=2) + FLOOR * floor


def log_likelihood(squares: np.ndarray, effective: np.ndarray) -> np.ndarray:
    """(n,) sum over windows and channels of -(n_eff / 2) log(mean square): Gaussian, with its variance unknown.

    squares : (n, W, C). effective : (W, C) independent samples in each.
    """
    return -0.5 * np.nansum(effective * np.log(squares), axis=(1, 2))


def objective(points: Sequence[Point], residuals: np.ndarray, sample: Sample) -> np.ndarray:
    """(n,) negative log posterior of points with residuals (n, W, T, C)."""
    penalty = np.array([p.penalty for p in points])
    return penalty - log_likelihood(mean_squares(residuals, sample.data.floor), sample.effective)


def information(
    point: Point, residual: np.ndarray, slope: np.ndarray, sample: Sample
) -> tuple[np.ndarray, np.ndarray]:
    """Curvature (D, D) and downhill direction (D,) of the objective at a point, D = P' + K.

    residual : (W, T, C). slope : (D, W, T, C) its derivatives.
    """
    weight = sample.effective / mean_squares(residual[None], sample.data.floor)[0]
    count = np.maximum(np.isfinite(residual).sum(axis=1), 1)
    weight = np.where(np.isfinite(weight), weight, 0.0) / count  # (W, C) of each sample
    r = np.nan_to_num(residual)
    j = np.nan_to_num(slope)
    weighted = (j * weight[None, :, None, :]).reshape(len(j), -1)
    curvature = weighted @ j.reshape(len(j), -1).T
    downhill = -weighted @ r.reshape(-1)
    return curvature + np.diag(point.prior), downhill - point.prior * point.z

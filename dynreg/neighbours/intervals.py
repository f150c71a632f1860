"""Intervals of a synthesised simulator's parameters: what the residuals about it tell, and what they cannot."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.neighbours.synthesise import Local, Replays, taken

PRIOR = 12.0  # 1 / variance of a uniform prior on [0, 1]
MOST = PRIOR**-0.5  # its standard deviation: an interval is never wider than that of no data
NORMAL_90 = 1.645  # standard deviations to each side of a normal distribution that hold 90 %
FLAT = 0.25  # standard deviation in the unit cube from which on an interval is the prior's


@dataclass(frozen=True)
class Interval:
    """A parameter's value and 90 % interval, in its unit. at_bound : it lies on the edge of its range."""

    value: float
    low: float
    high: float
    at_bound: bool


@dataclass(frozen=True)
class Evidence:
    """What intervals are made of, besides the linear model.

    effective : independent samples in the residuals (duration over autocorrelation time).
    halved : (1, W', T, S') residuals where the time step is half as long; None where that was not replayed.
    """

    effective: float
    halved: np.ndarray | None = None


def estimates(
    replays: Replays,
    local: Local,
    unit: np.ndarray,
    evidence: Evidence,
    values_of: Callable[[np.ndarray], np.ndarray],
) -> dict[str, Interval]:
    """90 % intervals of each parameter around `unit` (P,). values_of : (P,) in their units of unit parameters (P,).

    A parameter that the recording says nothing about gets its whole range; so do parameters that can make up for each
    other. Errors of the model's form widen an interval as far as they differ from window to window, or as half the time
    step would change the answer, and no further.
    """
    free, space = np.flatnonzero(replays.free), replays.space
    window = local.index // np.prod(replays.residuals.shape[2:])
    sigma = np.zeros(len(unit))
    sigma[free] = _spread(local, window, evidence)
    low, value, high = (values_of(unit + z * sigma) for z in (-NORMAL_90, 0.0, NORMAL_90))
    flat = sigma > FLAT
    low, high = np.where(flat, space.bounds[:, 0], low), np.where(flat, space.bounds[:, 1], high)
    edge = space.at_bound(unit) & replays.free
    return {
        name: Interval(float(value[i]), float(low[i]), float(high[i]), bool(edge[i]))
        for i, name in enumerate(space.names)
    }


def _spread(local: Local, window: np.ndarray, evidence: Evidence) -> np.ndarray:
    """(P_free,) standard deviations in the unit cube. window : (F,) number of each feature's window.

    The larger of two: that of Laplace's approximation, for least absolute residuals with so many independent samples,
    and `_by_windows`. To both is added `_by_time_step`. None exceeds the prior's along any axis of the likelihood.
    """
    clear = local.clear
    if not clear.any():
        return np.full(local.jacobian.shape[1], MOST)
    jacobian, weight = local.jacobian[clear], local.weight[clear]
    hessian = jacobian.T @ (jacobian * weight[:, None])
    size = np.mean(np.abs(local.residual))
    # least absolute residuals with Gaussian noise of s: covariance (pi / 2) s^2 (J^T J)^-1, s = sqrt(pi / 2) size
    share = evidence.effective / (len(local.residual) * np.mean(local.weight))
    scale = share / (0.5 * np.pi * size) ** 2
    # an uncertain jacobian looks steeper than it is, most of all where the true one is flat
    curvature, axes = np.linalg.eigh(hessian - local.doubt)
    variance = 1.0 / (np.maximum(curvature, 0.0) * scale + PRIOR)
    # how far each axis moves for a unit of each weighted residual
    moves = scale * variance * (jacobian @ axes) * weight[:, None]
    laplace = axes**2 @ variance
    spread = np.maximum(laplace, _by_windows(moves * local.residual[clear][:, None], axes, window[clear]))
    if evidence.halved is None:
        return np.sqrt(spread)
    change = taken(evidence.halved, local.index)[0] - local.residual
    return np.sqrt(spread + _by_time_step(moves.T @ change[clear], axes))


def _by_windows(moves: np.ndarray, axes: np.ndarray, window: np.ndarray) -> np.ndarray:
    """(P_free,) variances that hold where residuals stay alike through a window: each window is one sample.

    A sandwich with clusters (Liang and Zeger 1986). moves : (F, P_free) that the residuals would make along the axes,
    the columns of (P_free, P_free).
    """
    windows, number = np.unique(window, return_inverse=True)
    total = np.zeros((len(windows), moves.shape[1]))
    np.add.at(total, number, moves)
    others = max(len(windows) - 1, 1)
    # Student's quantile for few windows, of a normal distribution's (Cornish and Fisher 1938, first order)
    student = 1.0 + (NORMAL_90**2 + 1.0) / (4.0 * others)
    total *= student * np.sqrt(len(windows) / others)
    total *= np.minimum(1.0, MOST / np.maximum(np.sqrt((total**2).sum(axis=0)), 1e-300))
    return ((total @ axes.T) ** 2).sum(axis=0)


def _by_time_step(shift: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(P_free,) variances whose 90 % reach to where no time step would leave the answer.

    shift : (P_free,) along the axes, of half the time step. Halved for ever, a step of first order moves it twice as
    far.
    """
    return (axes @ np.clip(2.0 * shift / NORMAL_90, -MOST, MOST)) ** 2

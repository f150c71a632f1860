"""Intervals of a synthesised simulator's parameters: what the residuals about it tell, and what they cannot."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.evidence.gaussian import Gaussian, correlations_of
from dynreg.evidence.interval import NORMAL_90
from dynreg.neighbours.synthesise import Local, Replays, taken

PRIOR = 12.0  # 1 / variance of a uniform prior on [0, 1]
MOST = PRIOR**-0.5  # its standard deviation: an interval is never wider than that of no data
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
) -> tuple[dict[str, Interval], Gaussian]:
    """90 % intervals of each parameter around `unit` (P,), and the posterior of the free ones that they come from.

    values_of : (P,) in their units of unit parameters (P,).

    A parameter that the recording says nothing about gets its whole range; so do parameters that can make up for each
    other. Errors of the model's form widen an interval as far as they differ from window to window, or as half the time
    step would change the answer, and no further.
    """
    free, space = np.flatnonzero(replays.free), replays.space
    window = local.index // np.prod(replays.residuals.shape[2:])
    sigma = np.zeros(len(unit))
    sigma[free], correlations = _spread(local, window, evidence)
    low, value, high = (values_of(unit + z * sigma) for z in (-NORMAL_90, 0.0, NORMAL_90))
    flat = sigma > FLAT
    low, high = np.where(flat, space.bounds[:, 0], low), np.where(flat, space.bounds[:, 1], high)
    edge = space.at_bound(unit) & replays.free
    intervals = {
        name: Interval(float(value[i]), float(low[i]), float(high[i]), bool(edge[i]))
        for i, name in enumerate(space.names)
    }
    own = [space.parameters[i] for i in free]
    posterior = Gaussian(
        names=tuple(p.name for p in own),
        scales=tuple(p.scale for p in own),
        limits=space.bounds[free],
        centre=np.clip(unit[free], 0.0, 1.0),
        deviations=sigma[free],
        correlations=correlations,
        untold=tuple(p.name for p, nothing in zip(own, flat[free], strict=True) if nothing),
    )
    return intervals, posterior


def _spread(local: Local, window: np.ndarray, evidence: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """(P_free,) standard deviations in the unit cube, and their correlations (P_free, P_free).

    window : (F,) number of each feature's window.

    A variance is the larger of two: that of Laplace's approximation, for least absolute residuals with so many
    independent samples, and `_by_windows`. To both is added `_by_time_step`. None exceeds the prior's along any axis of
    the likelihood. Correlations are those of the same three matrices; see `_larger`.
    """
    clear = local.clear
    free = local.jacobian.shape[1]
    if not clear.any():
        return np.full(free, MOST), np.eye(free)
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
    pulls = _by_windows(moves * local.residual[clear][:, None], window[clear])
    spread = np.maximum(laplace, ((pulls @ axes.T) ** 2).sum(axis=0))
    covariance = _larger(axes, variance, pulls)
    if evidence.halved is not None:
        change = taken(evidence.halved, local.index)[0] - local.residual
        shift = axes @ _by_time_step(moves.T @ change[clear])
        spread, covariance = spread + shift**2, covariance + np.outer(shift, shift)
    return np.sqrt(spread), correlations_of(covariance)


def _larger(axes: np.ndarray, variance: np.ndarray, pulls: np.ndarray) -> np.ndarray:
    """(P_free, P_free) covariance: along every direction the larger of Laplace's and that of the windows.

    axes : the columns of (P_free, P_free), along which Laplace's has these variances (P_free,). pulls : (W, P_free) of
    the windows along the axes. Where Laplace's is a sphere, the axes of the windows' are those of both: there each
    takes the larger (the least matrix that is above both).
    """
    root = np.sqrt(variance)
    _, sizes, directions = np.linalg.svd(pulls / root, full_matrices=False)
    more = directions.T * np.sqrt(np.maximum(sizes**2 - 1.0, 0.0))
    own = axes * root
    return own @ (np.eye(len(root)) + more @ more.T) @ own.T


def _by_windows(moves: np.ndarray, window: np.ndarray) -> np.ndarray:
    """(W, P_free) shifts along the axes, whose squares add up to variances that hold where residuals stay alike through
    a window: each window is one sample.

    A sandwich with clusters (Liang and Zeger 1986). moves : (F, P_free) that the residuals would make along the axes.
    """
    windows, number = np.unique(window, return_inverse=True)
    total = np.zeros((len(windows), moves.shape[1]))
    np.add.at(total, number, moves)
    others = max(len(windows) - 1, 1)
    # Student's quantile for few windows, of a normal distribution's (Cornish and Fisher 1938, first order)
    student = 1.0 + (NORMAL_90**2 + 1.0) / (4.0 * others)
    total *= student * np.sqrt(len(windows) / others)
    return total * np.minimum(1.0, MOST / np.maximum(np.sqrt((total**2).sum(axis=0)), 1e-300))


def _by_time_step(shift: np.ndarray) -> np.ndarray:
    """(P_free,) standard deviations along the axes whose 90 % reach to where no time step would leave the answer.

    shift : (P_free,) along the axes, of half the time step. Halved for ever, a step of first order moves it twice as
    far.
    """
    return np.clip(2.0 * shift / NORMAL_90, -MOST, MOST)

"""A better simulator from replays: parameters that explain what the replayed candidates left unexplained.

Every replay is a sample of the map from parameters to residuals. A local linear model of that map, fitted to
all replays so far with weight on the good ones, gives a step (regularised Gauss-Newton on absolute residuals);
the simulators it proposes are replayed in turn and sharpen the model. No derivatives are simulated, which is
what makes it cheap (Iglesias et al. 2013 call the one-round form ensemble Kalman inversion) and robust where
contacts make single derivatives meaningless.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.replay.windows import errors
from dynreg.rng import stream
from dynreg.sim.space import ParameterSpace

DAMPING = (0.01, 0.1)  # of the bold and the careful step, in units of the mean curvature
REACH = 0.15  # of the exploring step, in the unit cube; shrinks when a round gains little
FEATURES = 2000  # residual samples kept for the linear model
Residuals = Callable[[np.ndarray], np.ndarray]  # of unit parameters (n, P): (n, W', T, S')


@dataclass(frozen=True, eq=False)
class Replays:
    """Replays of one recording: unit parameters (n, P), residuals (n, W, T, S'), errors (n,) on fit and select.

    free : (P,) parameters that may change (those that are known of the robot may not). to_fit : (W',) which of the
    replayed windows are to fit; the residuals of these alone are kept.
    """

    space: ParameterSpace
    free: np.ndarray
    to_fit: np.ndarray
    unit: np.ndarray
    residuals: np.ndarray
    fit: np.ndarray
    select: np.ndarray

    def grown(self, unit: np.ndarray, residuals: np.ndarray) -> "Replays":
        """With the replays of unit parameters (m, P), residuals (m, W', T, S') over all replayed windows."""
        more = replays_of(self.space, self.free, self.to_fit, unit, residuals)
        columns = ("unit", "residuals", "fit", "select")
        return replace(self, **{c: np.concatenate([getattr(self, c), getattr(more, c)]) for c in columns})

    @property
    def score(self) -> np.ndarray:
        """(n,) mean error over the windows of fit and select: what ranks replays."""
        share = float(self.to_fit.mean())
        return share * self.fit + (1.0 - share) * self.select


def replays_of(
    space: ParameterSpace, free: np.ndarray, to_fit: np.ndarray, unit: np.ndarray, residuals: np.ndarray
) -> Replays:
    """Of the first replays: unit parameters (n, P), residuals (n, W', T, S') over all replayed windows."""
    error, rest = errors(residuals), ~to_fit
    select = (error[:, rest] if rest.any() else error).mean(axis=1)
    mine = residuals[:, to_fit].astype(np.float32)
    return Replays(space, free, to_fit, unit, mine, error[:, to_fit].mean(axis=1), select)


def refine(replays: Replays, replay: Residuals, budget: int, seed: int) -> Replays:
    """The replays after rounds of proposals, `budget` more than before.

    replay : residuals (n, W', T, S') of unit parameters (n, P).
    """
    reach = REACH
    while budget > 0:
        best = replays.score.min()
        proposals = propose(replays, reach, seed)[:budget]
        replays = replays.grown(proposals, replay(proposals))
        budget -= len(proposals)
        if replays.score.min() > 0.98 * best:
            reach *= 0.7
    return replays


def propose(replays: Replays, reach: float, seed: int) -> np.ndarray:
    """(3, P) unit parameters to replay next: a bold step, a careful one, and one that explores.

    The exploring one goes `reach` away from the careful one, farthest where the residuals hardly change: it is
    there that the linear model knows least.
    """
    local = linearise(replays)
    lead, free = local.centre, np.flatnonzero(replays.free)
    rng = stream(seed, "synthesise", len(replays.unit))
    hessian, slope = normal_equations(local)
    scale = np.trace(hessian) / len(free) + 1e-12
    steps = [np.linalg.solve(hessian + d * scale * np.eye(len(free)), slope) for d in DAMPING]
    curvature, directions = np.linalg.eigh(hessian / scale + 0.05 * np.eye(len(free)))
    astray = directions @ (rng.standard_normal(len(free)) / np.sqrt(curvature))
    astray *= reach / np.linalg.norm(astray)
    proposals: list[np.ndarray] = []
    for move in (-steps[0], -steps[1], -steps[1] + astray):
        point = lead.copy()
        point[free] = np.clip(lead[free] + move, 0.0, 1.0)
        if any(np.abs(point - other).max() < 2e-3 for other in [*proposals, *replays.unit]):
            jitter = 0.5 * reach / np.sqrt(len(free)) * rng.standard_normal(len(free))
            point[free] = np.clip(point[free] + jitter, 0.0, 1.0)
        proposals.append(point)
    return np.array(proposals)


@dataclass(frozen=True)
class Local:
    """A linear model of the residuals around the best replay.

    centre : (P,) unit parameters of the best replay.
    jacobian : (F, P_free) change of the residual features with each free parameter.
    residual : (F,) residual features at the centre.
    weight : (F,) weights that make squares of residuals into absolute values (iteratively reweighted).
    doubt : (P_free, P_free) what errors of the jacobian add to its weighted square, on average.
    index : (F,) where the features stand in the residuals of a replay, laid flat.
    clear : (F,) whether a feature's slopes are sure enough for intervals.
    """

    centre: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    doubt: np.ndarray
    index: np.ndarray
    clear: np.ndarray


def linearise(replays: Replays) -> Local:
    """Weighted ridge regression of the residuals of all replays on their parameters, around the best one."""
    best = int(np.argmin(replays.score))
    index = features(replays, FEATURES)
    flat = taken(replays.residuals, index)
    free = np.flatnonzero(replays.free)
    offset = (replays.unit - replays.unit[best])[:, free]
    apart = (offset**2).sum(axis=1)
    # near replays and good ones say most about the map here; the width is that of the 2 P nearest
    width = np.sort(apart)[min(len(apart) - 1, 2 * len(free))]
    w = 1.0 / (apart + 0.1 * width + 1e-4)
    w *= np.exp(-np.minimum(replays.score / replays.score[best] - 1.0, 3.0) / 0.5)
    w[best] = 0.0
    weighted = (offset * w[:, None]).T
    gram = weighted @ offset
    gram += (0.02 * np.trace(gram) / max(len(free), 1) + 1e-12) * np.eye(len(free))
    influence = np.linalg.solve(gram, weighted)
    change = flat - flat[best]
    jacobian = (influence @ change).T
    residual = flat[best]
    weight = weights(residual)
    # what each replay would be wrong by if it were left out (HC3, MacKinnon and White 1985): curvature of the
    # map counts as an error of its slope
    leverage = np.einsum("pi,ip->i", influence, offset)
    missed = ((change - offset @ jacobian.T) ** 2 @ weight) / np.maximum(1.0 - leverage, 0.05) ** 2
    doubt = (influence * missed) @ influence.T
    return Local(
        replays.unit[best], jacobian, residual, weight, doubt, index, np.ones(len(index), dtype=bool)
    )


def features(replays: Replays, most: int) -> np.ndarray:
    """(F,) where about `most` residuals stand, evenly taken of all that every replay has."""
    known = np.flatnonzero(~np.isnan(replays.residuals).any(axis=0))
    return known[:: max(1, len(known) // most)]


def taken(residuals: np.ndarray, index: np.ndarray) -> np.ndarray:
    """(n, F) the residuals (n, W', T, S') that stand at `index`."""
    return residuals.reshape(len(residuals), -1)[:, index].astype(float)


def weights(residual: np.ndarray) -> np.ndarray:
    """(F,) weights that make squares of residuals (F,) into absolute values, small ones held back."""
    return 1.0 / np.maximum(np.abs(residual), 0.3 * np.mean(np.abs(residual)) + 1e-9)


def normal_equations(local: Local) -> tuple[np.ndarray, np.ndarray]:
    """(P_free, P_free) weighted square of the jacobian, (P_free,) its weighted product with the residual."""
    weighted = local.jacobian * local.weight[:, None]
    return local.jacobian.T @ weighted, weighted.T @ local.residual

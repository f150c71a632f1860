"""A better simulator from replays: parameters that explain what the replayed candidates left unexplained.

Every replay is a sample of the map from parameters to residuals. A local linear model of that map, fitted to
all replays so far with weight on the good ones, gives a step (regularised Gauss-Newton on absolute residuals);
the simulators it proposes are replayed in turn and sharpen the model. No derivatives are simulated, which is
what makes it cheap (Iglesias et al. 2013 call the one-round form ensemble Kalman inversion) and robust where
contacts make single derivatives meaningless.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.neighbours.replay import Replayer, errors
from dynreg.results import Estimate
from dynreg.rng import stream
from dynreg.sim.space import ParameterSpace

DAMPING = (0.03, 0.3, 3.0)  # trust regions tried in each round, from bold to careful
PRIOR = 12.0  # 1 / variance of a uniform prior on [0, 1]
FEATURES = 2000  # residual samples kept for the linear model


@dataclass
class Evidence:
    """Replays of one recording: unit parameters (n, P), residuals (n, W, T, S'), errors on fit and select.

    `free` marks the parameters that may change (those that are known of the robot may not).
    """

    space: ParameterSpace
    free: np.ndarray
    unit: np.ndarray
    residuals: np.ndarray
    fit: np.ndarray
    select: np.ndarray

    def add(self, unit: np.ndarray, residuals: np.ndarray, fit_windows: np.ndarray) -> None:
        """Append replays; residuals over all replayed windows, of which `fit_windows` (W,) bool are to fit."""
        e = errors(residuals)
        self.unit = np.concatenate([self.unit, unit])
        self.residuals = np.concatenate([self.residuals, residuals[:, fit_windows].astype(np.float32)])
        self.fit = np.concatenate([self.fit, e[:, fit_windows].mean(axis=1)])
        rest = e[:, ~fit_windows]
        self.select = np.concatenate([self.select, rest.mean(axis=1) if rest.shape[1] else e.mean(axis=1)])

    @property
    def score(self) -> np.ndarray:
        """(n,) error over fit and select together: what ranks replays."""
        return 0.5 * (self.fit + self.select)


def empty_evidence(space: ParameterSpace, free: np.ndarray) -> Evidence:
    """Evidence without replays."""
    nothing = np.zeros(0)
    return Evidence(space, free, np.zeros((0, len(space))), np.zeros((0, 0, 0, 0)), nothing, nothing)


def refine(
    evidence: Evidence,
    replay: Callable[[np.ndarray], None],
    budget: int,
    seed: int,
) -> None:
    """Rounds of proposals until `budget` replays are spent or a round gains less than half a per cent.

    replay : replays unit parameters (n, P) and adds them to the evidence.
    """
    idle = 0
    while budget > 0:
        best = evidence.score.min()
        proposals = propose(evidence, seed)[:budget]
        replay(proposals)
        budget -= len(proposals)
        idle = idle + 1 if evidence.score.min() > 0.995 * best else 0
        if idle >= 2:
            return


def propose(evidence: Evidence, seed: int) -> np.ndarray:
    """(3, P) unit parameters to replay next, one for each damping, drawn apart where they coincide."""
    centre, jacobian, residual, weight = linearise(evidence)
    lead = evidence.unit[np.argmin(evidence.score)]
    rng = stream(seed, "synthesise", len(evidence.unit))
    free = np.flatnonzero(evidence.free)
    hessian, slope = _normal_equations(jacobian, residual, weight)
    scale = np.trace(hessian) / max(len(free), 1)
    proposals = []
    for damping in DAMPING:
        step = np.linalg.solve(hessian + damping * scale * np.eye(len(free)) / 10, slope)
        point = lead.copy()
        point[free] = np.clip(centre[free] - step, 0.0, 1.0)
        if any(np.abs(point - other).max() < 1e-3 for other in [*proposals, *evidence.unit]):
            point[free] = np.clip(point[free] + 0.03 * rng.standard_normal(len(free)), 0.0, 1.0)
        proposals.append(point)
    return np.array(proposals)


def linearise(evidence: Evidence) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The local linear model of the residuals around the best replay.

    Returns
    -------
    centre : (P,) unit parameters of the best replay.
    jacobian : (F, P_free) change of the residual features with each free parameter.
    residual : (F,) residual features at the centre.
    weight : (F,) weights that make squares of residuals into absolute values (iteratively reweighted).
    """
    best = int(np.argmin(evidence.score))
    flat = evidence.residuals.reshape(len(evidence.unit), -1)
    keep = ~np.isnan(flat).any(axis=0)
    flat = flat[:, keep]
    step = max(1, flat.shape[1] // FEATURES)
    flat = flat[:, ::step].astype(float)
    free = np.flatnonzero(evidence.free)
    offset = (evidence.unit - evidence.unit[best])[:, free]
    # good replays and near ones say most about the map here
    near = np.exp(-0.5 * (offset**2).sum(axis=1) / (0.25**2 * len(free)))
    good = np.exp(-(evidence.score / evidence.score[best] - 1.0) / 0.3)
    w = near * good
    w[best] = 0.0
    change = flat - flat[best]
    gram = (offset * w[:, None]).T @ offset
    ridge = 1e-3 * np.trace(gram) / len(free) + 1e-9
    jacobian = np.linalg.solve(gram + ridge * np.eye(len(free)), (offset * w[:, None]).T @ change).T
    residual = flat[best]
    weight = 1.0 / np.maximum(np.abs(residual), 0.3 * np.mean(np.abs(residual)) + 1e-9)
    return evidence.unit[best], jacobian, residual, weight


def estimates(evidence: Evidence, unit: np.ndarray, effective: float) -> dict[str, Estimate]:
    """90 % intervals of each parameter around `unit` (P,): Laplace approximation of the local linear model.

    effective : independent samples in the residuals (duration over autocorrelation time). A parameter that the
    recording says nothing about gets its whole range. The intervals hold if the model is right.
    """
    _, jacobian, residual, weight = linearise(evidence)
    hessian, _ = _normal_equations(jacobian, residual, weight)
    size = np.mean(np.abs(residual))
    information = hessian * effective / (len(residual) * size)
    free = np.flatnonzero(evidence.free)
    covariance = np.linalg.inv(information + PRIOR * np.eye(len(free)))
    sigma = np.zeros(len(unit))
    sigma[free] = np.sqrt(np.diag(covariance))
    value = evidence.space.from_unit(unit)
    low = evidence.space.from_unit(unit - 1.645 * sigma)
    high = evidence.space.from_unit(unit + 1.645 * sigma)
    # a flat parameter's Laplace interval is its prior's: show it as the whole range
    flat = sigma > 0.25
    bounds = evidence.space.bounds
    low, high = np.where(flat, bounds[:, 0], low), np.where(flat, bounds[:, 1], high)
    edge = ((unit < 0.005) | (unit > 0.995)) & evidence.free
    return {
        p.name: Estimate(
            value=float(value[i]),
            low=float(low[i]),
            high=float(high[i]),
            unit=p.unit,
            nominal=p.nominal,
            at_bound=bool(edge[i]),
        )
        for i, p in enumerate(evidence.space.parameters)
    }


def effective_samples(residuals: np.ndarray) -> float:
    """Independent samples in residuals (W, T, S'): rows over twice the mean autocorrelation time."""
    count = 0.0
    for window in residuals:
        for series in np.asarray(window, dtype=float).T:
            x = series[~np.isnan(series)]
            x = x - x.mean() if len(x) else x
            if len(x) < 4 or not np.any(x):
                continue
            spectrum = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
            correlation = np.fft.irfft(spectrum)[: len(x)] / (x @ x)
            until = int(np.argmax(correlation < 0)) or len(x)
            count += len(x) / max(2 * correlation[:until].sum() - 1, 1.0)
    return max(count, 1.0)


def _normal_equations(
    jacobian: np.ndarray, residual: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    weighted = jacobian * weight[:, None]
    return jacobian.T @ weighted, weighted.T @ residual


def replay_into(
    evidence: Evidence, replayer: Replayer, chosen: np.ndarray, fit_windows: np.ndarray
) -> Callable[[np.ndarray], None]:
    """A `replay` for `refine`: simulates unit parameters in the chosen windows and adds them."""

    def replay(unit: np.ndarray) -> None:
        values = evidence.space.from_unit(unit)
        residuals = replayer.residuals(values, chosen)
        if not len(evidence.unit):
            evidence.residuals = np.zeros((0, int(fit_windows.sum()), *residuals.shape[2:]), dtype=np.float32)
        evidence.add(unit, residuals, fit_windows)

    return replay

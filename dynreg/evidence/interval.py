"""Intervals: the posterior of all coordinates of a hypothesis; valleys and bounds have no curvature, so it is sampled.

Where rollouts are dear (MuJoCo) it is the normal distribution of that curvature.

Adaptive importance sampling (Cappe, Guillin, Marin, Robert: Population Monte Carlo, J. Comput. Graph. Stat. 13, 2004)
with the weights of the deterministic mixture of all rounds (Cornuet, Marin, Mira, Robert: Adaptive Multiple Importance
Sampling, Scand. J. Stat. 39, 2012). Proposals are Student t: their tails must not be shorter than the posterior's.
Two things widen it where the model is wrong. Samples count by the autocorrelation time of the residual; and where the
windows pull at the parameters more than their own noise would let them, the likelihood is raised to the power that
makes the two agree, and lower by what all windows may have in common (Pauli, Racugno, Ventura: Bayesian composite
marginal likelihoods, Stat. Sinica 21, 2011; Mueller: Risk of Bayesian inference in misspecified models, Econometrica
81, 2013). Where so few draws carry the weight that they tell no interval, the weights are flattened until enough do
(Koblents, Miguez: A population Monte Carlo scheme with transformed weights, Stat. Comput. 25, 2015).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from dynreg.evidence.data import Sample
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.likelihood import information, mean_squares, objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import NONE, Model
from dynreg.evidence.point import Point, bounds
from dynreg.evidence.slopes import sensitivities
from dynreg.rng import stream
from dynreg.sim.engine import ENGINES

NINETY = (0.05, 0.95)  # the ends of a 90 % interval
NORMAL_90 = 1.645  # standard deviations from the middle of a normal distribution's to either end
# bench_constants: 10 of 14 intervals hold the size, 23 % of it wide. Half of ROUNDS and DRAWS hold 9, 18 % wide, twice
# 10, 24 %, in 1.6 times the time; half and twice of ENOUGH and PLENTY 10, 23 and 26 %. Anything does from 5 to 20 of
# FREEDOM (20 to 23 %), 1 to 1.3 of WIDER (23 to 24 %), 10 to 40 of TRIED (23 to 25 %).
ROUNDS = 6  # of proposals, each made of what the last ones found, the first of the curvature,
DRAWS = 150  # in each
FREEDOM = 10.0  # degrees of freedom of the proposals
WIDER = 1.1  # than the draws so far
TRIED = 20  # times the draws: what a proposal may throw beyond the bounds
ENOUGH = 40.0  # draws, in equivalents of equal weight, that an interval takes,
PLENTY = 150.0  # and at which no more rounds are needed
# On 122 servos of bench_intervals' development, of both generators, 90 % intervals hold 0.83 of the sizes with 0 of
# COMMON, 0.885 with 0.5, 0.893 with 1 and 0.918 with 1.5.
COMMON = 1.0  # times what noise makes pulls vary: what all rollouts have in common, which none of them tells
LITTLE = 1e-6  # coordinates' worth of what rollouts tell: less is rounding
CLOSE = 1e-4  # of a power that weights are raised to: how exactly it is sought; no draw's weight tells less


@dataclass(frozen=True)
class Posterior:
    """Weighted draws z (N, D) of a hypothesis' coordinates; weights (N,) sum to 1.

    power : to which the likelihood was raised; 1 / (1 + COMMON) where the windows agree, less where they do not.
    flat : in (0, 1], to which the weights were raised; 1 where enough draws carry the weight.
    """

    hypothesis: Hypothesis
    z: np.ndarray
    weights: np.ndarray
    power: float
    flat: float

    def quantiles(self, values: np.ndarray, at: tuple[float, ...] = NINETY) -> np.ndarray:
        """(len(at), ...) weighted quantiles of values (N, ...), one row for each draw."""
        return np.quantile(values, at, axis=0, weights=self.weights, method="inverted_cdf")


@dataclass(frozen=True)
class Proposal:
    """A Student t about `middle` (D,) with scale matrix `spread` (D, D), cut off at limits (D, 2)."""

    middle: np.ndarray
    spread: np.ndarray
    limits: np.ndarray

    def draw(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, float]:
        """At most `count` draws (n, D) within the limits, and the logarithm of the share that lay there."""
        size = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, TRIED * count))
        root = np.linalg.cholesky(self.spread)
        z = self.middle + size[:, None] * (rng.standard_normal((len(size), len(root))) @ root.T)
        inside = ((z >= self.limits[:, 0]) & (z <= self.limits[:, 1])).all(axis=1)
        return z[inside][:count], float(np.log(max(inside.mean(), 1.0 / len(z))))

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """(n,) of draws z (n, D), before the cut."""
        return np.atleast_1d(multivariate_t.logpdf(z, self.middle, self.spread, FREEDOM))


def posterior(model: Model, point: Point, sample: Sample, *, seed: int = 0) -> Search[Posterior]:
    """The posterior about its maximum `point`, by the windows of a sample.

    The prior of nominal coordinates is the nameplate; of shapes, a factor of three; of sizes, normal about zero with
    the strong size as its standard deviation. Robots without a vectorised engine, where draws are dear, get its normal
    approximation, cut off at the bounds.
    """
    engine, limits = _vectorised(model), bounds(model.coordinates, point.hypothesis)
    if engine not in (None, model.running):  # the corrections are of the other engine's time step
        model = replace(model, engine=engine, corrections=NONE)
    (residual,), (slope,) = yield from sensitivities(model, [point], sample)
    sample = sample.reweighted(residual)
    curvature, _ = information(point, residual, slope, sample)
    width = prior_widths(point)
    # what the priors of sizes add: `information` has the other coordinates' already
    curvature += np.diag(np.where(point.prior == 0, 1.0 / width**2, 0.0) + 1e-9)
    agreed = _agreement(residual, slope, sample, curvature)
    rng = stream(seed, "interval", point.hypothesis.key)
    tempered = agreed * curvature + (1.0 - agreed) * np.diag(1.0 / width**2)
    if engine is None:
        return _approximation(point, tempered, limits, rng, agreed)
    proposals = [Proposal(point.z, np.linalg.inv(tempered), limits)]
    made, inside, likelihood = [], [], []
    while True:
        new, cut = proposals[-1].draw(rng, DRAWS)
        if len(new) < ENOUGH:  # nearly all lie beyond bounds: no weights would tell anything
            return _approximation(point, tempered, limits, rng, agreed)
        made.append(new)
        inside.append(cut)
        points = [point.moved(one) for one in new]
        price = objective(points, (yield from model.residuals(points, sample)), sample)
        likelihood.append(np.array([p.penalty for p in points]) - price)
        z = np.concatenate(made)
        target = agreed * np.concatenate(likelihood) - 0.5 * np.sum((z / width) ** 2, axis=1)
        drawn = [
            p.log_density(z) - cut + np.log(max(len(own), 1))
            for p, cut, own in zip(proposals, inside, made, strict=True)
        ]
        weights, flat = _weighted(target - logsumexp(drawn, axis=0))
        if len(proposals) >= ROUNDS or (flat == 1.0 and 1.0 / np.sum(weights**2) > PLENTY):
            return Posterior(point.hypothesis, z, weights, agreed, flat)
        spread = np.cov(z.T, aweights=weights).reshape(len(width), -1)
        proposals.append(Proposal(weights @ z, WIDER**2 * spread + 1e-8 * np.eye(len(width)), limits))


def _vectorised(model: Model) -> str | None:
    """The vectorised engine that the robot's rollouts can run on: its own, or another of a robot of one joint.

    Moved alone, joints of a chain or on the ground are another robot.
    """
    others = model.robot.engines if len(model.robot.actions) == 1 else ()
    return next((name for name in (model.running, *others) if ENGINES[name].vectorised), None)


def _approximation(
    point: Point, curvature: np.ndarray, limits: np.ndarray, rng: np.random.Generator, power: float
) -> Posterior:
    """Draws of the normal distribution about a point that has the posterior's curvature there."""
    root = np.linalg.cholesky(np.linalg.inv(curvature))
    z = point.z + rng.standard_normal((ROUNDS * DRAWS, len(root))) @ root.T
    z = np.clip(z, *limits.T)
    return Posterior(point.hypothesis, z, np.full(len(z), 1.0 / len(z)), power, 1.0)


def prior_widths(point: Point) -> np.ndarray:
    """(P' + K,) standard deviations of the prior of a point's coordinates."""
    strong = [
        1.0 if p.shape else (p.medium / p.strong if p.inverse else p.strong / p.medium)
        for p in point.hypothesis.parameters
    ]
    return np.concatenate([np.ones(len(point.nominal)), np.maximum(strong, 1.0)])


def _agreement(residual: np.ndarray, slope: np.ndarray, sample: Sample, curvature: np.ndarray) -> float:
    """The power of the likelihood: what the pulls of rollouts on coordinates should vary by, over what they do.

    A mean over directions. What one part of a rollout pulls, the others pull with it. A fit takes off part of each
    rollout's pull, the more the more of what is known this rollout tells: by as much less they should vary (leverage:
    MacKinnon and White, J. Econometrics 29, 1985). curvature : (D, D) of the posterior, its priors included.
    """
    squares = mean_squares(residual[None], sample.data.floor)[0]
    count = np.maximum(np.isfinite(residual).sum(axis=1), 1)
    weight = np.nan_to_num(sample.effective / squares) / count
    slope, rollouts = np.nan_to_num(slope), len(residual) // sample.data.segments
    pulls = np.einsum("dwtc,wtc,wc->wd", slope, np.nan_to_num(residual), weight)
    pulls = pulls.reshape(rollouts, -1, len(curvature)).sum(axis=1)
    told = np.einsum("dwtc,wc,ewtc->wde", slope, weight, slope, optimize=True)
    told = told.reshape(rollouts, -1, *curvature.shape).sum(axis=1)
    share = np.linalg.solve(curvature, told)  # (W, D, D) of what is known that each rollout tells
    should = np.trace(share - share @ share, axis1=1, axis2=2).sum()
    found = np.trace(np.linalg.solve(curvature, pulls.T @ pulls))
    # where next to nothing is told, rollouts cannot disagree
    return float(1.0 / (max(found / max(should, LITTLE), 1.0) + COMMON))


def _weighted(log: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights (n,) from logarithms of posterior over proposal, and the power that they had to be raised to.

    Flattened weights lie between the posterior and what was drawn, which the next round improves.
    """

    def weights(power: float) -> np.ndarray:
        return np.exp(power * log - logsumexp(power * log))

    def lacking(power: float) -> float:
        return float(1.0 / np.sum(weights(power) ** 2)) - min(ENOUGH, 0.5 * len(log))

    if lacking(1.0) >= 0:
        return weights(1.0), 1.0
    power = brentq(lacking, 0.0, 1.0, xtol=CLOSE)
    return weights(power), float(power)

"""Separability of a cause: similar effects (rivals) that widen the interval of its size when they may act as well.

The curvature alone ranks the declared rivals: it shows how collinear their changes of the motion are (the variance
inflation of D. Belsley, E. Kuh, R. Welsch, Regression Diagnostics, 1980; as a test of identifiability R. Brun,
P. Reichert, H. Kuensch, Water Resour. Res. 37, 2001). The most collinear are fitted and sampled together with the
cause, because the posterior is not Gaussian there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.interval import Posterior, posterior
from dynreg.evidence.likelihood import information
from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities, slopes
from dynreg.sim.effects import Term, one_group
from dynreg.sim.robot import Robot

# On bench_constants SHARED of 1.25, 1.5 and 2 gives 13, 7 and 3 inseparable pairs; SAMPLED of one gives 4 of the 7, of
# six no more; half and twice of SIZES give 6 and 7, fewest and most iterations 7 and 6.
SHARED = 1.5  # times the interval without the rival: from this growth on the two are inseparable, by contract
SAMPLED = 3  # rivals that are fitted and sampled
SIZES = (0.3, 1.5)  # medium sizes of a rival from which its fit with the cause starts
# Iterations of all starts with the derivatives of the cause alone, starts kept, and their iterations with derivatives
# of their own. On the XL330 log this gives 99.4 nats, for half the rollouts of own derivatives throughout (97.3 nats).
BEGUN, KEPT, ENDED = 1, 2, 3


@dataclass(frozen=True)
class PairFit:
    """A cause and a rival fitted together: the last two terms of `point`, with posterior draws.

    alike, growth : how much the uncertainty of the cause's first parameter grows when the rival may act as well; the
    ratio of standard deviations by the curvature, and of interval widths by the draws.
    """

    point: Point
    draws: Posterior
    alike: float
    growth: float

    @property
    def pair(self) -> tuple[Term, Term]:
        """The cause and its rival."""
        cause, rival = self.point.hypothesis.terms[-2:]
        return cause, rival

    @property
    def inseparable(self) -> bool:
        """Whether the rival makes the cause's size uncertain, by the curvature and by the draws."""
        return min(self.alike, self.growth) >= SHARED


def fit_pairs(
    model: Model, point: Point, alone: Posterior, rivals: Sequence[Term], sample: Sample, seed: int = 0
) -> Search[tuple[PairFit, ...]]:
    """The last term of `point` (its draws: `alone`), fitted with each of its most collinear rivals on the sample."""
    if not rivals:
        return ()
    (residual,), (slope,) = yield from sensitivities(model, [point], sample)
    sample = sample.reweighted(residual)
    doubled = [with_term(point, rival, 0.0) for rival in rivals]
    at = len(point.z) - _many(point)
    alike = yield from _collinear(model, doubled, at, sample, slope)
    ends = alone.quantiles(alone.z[:, at])

    def one(i: int) -> Search[PairFit]:
        signs = (1.0, -1.0) if rivals[i].effect.parameters[0].signed else (1.0,)
        starts = [doubled[i], *(with_term(point, rivals[i], sign * size) for size in SIZES for sign in signs)]
        begun, cost = yield from fit(model, starts, sample, iterations=BEGUN, leading=slope)
        ended = yield from fit(model, best_of(begun, cost, KEPT), sample, iterations=ENDED)
        best = best_of(*ended)[0]
        draws = yield from posterior(model, best, sample, seed=seed)
        growth = float(np.ptp([ends, draws.quantiles(draws.z[:, at])]) / max(np.ptp(ends), 1e-9))
        return PairFit(best, draws, float(alike[i]), growth)

    out = yield from together([one(i) for i in np.argsort(-alike, kind="stable")[:SAMPLED]])
    return tuple(sorted(out, key=lambda one: -one.growth))


def neighbours(robot: Robot, term: Term, among: Sequence[Term]) -> list[Term]:
    """The terms of `among` that may be confused with the term: on the same joints, not of the same exact group.

    One effect declares the other near, both belong to a group that is not exact on this robot, or they are the same on
    two bodies.
    """
    out = []
    for other in among:
        declared = other.effect.id in term.effect.near or term.effect.id in other.effect.near
        near = declared or (bool(term.effect.group) and other.effect.group == term.effect.group)
        elsewhere = other.bodies != term.bodies and other.effect.id == term.effect.id
        same = (other.effect.id == term.effect.id and not elsewhere) or one_group(robot, term, other)
        near = near or elsewhere
        if near and not same and (not term.joints or not other.joints or other.joints == term.joints):
            out.append(other)
    return out


def _many(point: Point) -> int:
    """The number of parameters of the last term."""
    return len(point.hypothesis.terms[-1].effect.parameters)


def with_term(point: Point, term: Term, size: float) -> Point:
    """The point with one more term at `size` times its medium sizes."""
    sizes = [0.0 if p.shape else size for p in term.effect.parameters]
    return Point(point.hypothesis.with_term(term), point.nominal, np.concatenate([point.effect, sizes]))


def _collinear(
    model: Model, points: list[Point], at: int, sample: Sample, leading: np.ndarray
) -> Search[np.ndarray]:
    """(n,) variance inflation (as standard deviation) of coordinate `at` when each point's last term is free.

    From the data alone, with the nominal parameters fixed: these could imitate a rival, and hide it. leading : (D, W,
    T, C) derivatives by the coordinates before the last term, whose size is zero here.
    """
    residual = yield from model.residuals(points, sample)
    own = yield from slopes(model, points, sample, leading)
    out = []
    for point, r, slope in zip(points, residual, own, strict=True):
        own = [at, *range(len(point.z) - _many(point), len(point.z))]
        curvature, _ = information(point, r, slope, sample)
        data = (curvature - np.diag(point.prior))[np.ix_(own, own)]
        size = np.sqrt(np.maximum(np.diag(data), 1e-12))
        alike = data / np.outer(size, size) + 1e-9 * np.eye(len(own))
        out.append(np.sqrt(np.linalg.inv(alike)[0, 0]))
    return np.array(out)

"""What a recording cannot tell apart: a cause, and the neighbours that make its size uncertain when they are let free.

Declared neighbours are first judged by the curvature alone: how collinear the changes of the motion are (the variance
inflation of D. Belsley, E. Kuh, R. Welsch, Regression Diagnostics, 1980; as a test of what can be identified R. Brun,
P. Reichert, H. Kuensch, Water Resour. Res. 37, 2001). The worst are fitted with the cause and sampled, as valleys bend.
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

# On bench_constants SHARED of 1.25, 1.5 and 2 has 13, 7 and 3 pairs that are not told apart; SAMPLED of one has 4 of
# the 7, of six no more; half and twice of SIZES have 6 and 7, fewest and most iterations 7 and 6.
SHARED = 1.5  # times the interval without the rival: from here on the two are not told apart, by contract
SAMPLED = 3  # rivals that are fitted and sampled
SIZES = (0.3, 1.5)  # medium sizes of a rival from which its fit with the cause starts
# Iterations of all starts with the derivatives that the cause has alone, those kept, and their iterations with their
# own: on the XL330 log 99.4 nats where all starts with their own reach 97.3, for half the rollouts.
BEGUN, KEPT, ENDED = 1, 2, 3


@dataclass(frozen=True)
class Together:
    """A cause and a rival, the last two terms of `point`, with draws of both.

    Of the cause's first parameter, with the rival free over with the cause alone: alike is the ratio of standard
    deviations by the curvature, growth that of the interval's width by draws.
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


def beside(
    model: Model, point: Point, alone: Posterior, rivals: Sequence[Term], sample: Sample, seed: int = 0
) -> Search[tuple[Together, ...]]:
    """The last term of `point` (draws: `alone`) with each of the rivals most like it in the windows of the sample."""
    if not rivals:
        return ()
    (residual,), (slope,) = yield from sensitivities(model, [point], sample)
    sample = sample.reweighted(residual)
    doubled = [with_term(point, rival, 0.0) for rival in rivals]
    at = len(point.z) - _many(point)
    alike = yield from _collinear(model, doubled, at, sample, slope)
    ends = alone.quantiles(alone.z[:, at])

    def one(i: int) -> Search[Together]:
        signs = (1.0, -1.0) if rivals[i].effect.parameters[0].signed else (1.0,)
        starts = [doubled[i], *(with_term(point, rivals[i], sign * size) for size in SIZES for sign in signs)]
        begun, cost = yield from fit(model, starts, sample, iterations=BEGUN, leading=slope)
        ended = yield from fit(model, best_of(begun, cost, KEPT), sample, iterations=ENDED)
        best = best_of(*ended)[0]
        draws = yield from posterior(model, best, sample, seed=seed)
        growth = float(np.ptp([ends, draws.quantiles(draws.z[:, at])]) / max(np.ptp(ends), 1e-9))
        return Together(best, draws, float(alike[i]), growth)

    out = yield from together([one(i) for i in np.argsort(-alike, kind="stable")[:SAMPLED]])
    return tuple(sorted(out, key=lambda one: -one.growth))


def neighbours(robot: Robot, term: Term, among: Sequence[Term]) -> list[Term]:
    """Those of `among` that may be mistaken for the term, on the same joints, and not of the same exact group.

    Either effect declares the other near, or they are of a group that is not exact on this robot.
    """
    out = []
    for other in among:
        declared = other.effect.id in term.effect.near or term.effect.id in other.effect.near
        near = declared or (bool(term.effect.group) and other.effect.group == term.effect.group)
        same = other.effect.id == term.effect.id or one_group(robot, term, other)
        if near and not same and (not term.joints or not other.joints or other.joints == term.joints):
            out.append(other)
    return out


def _many(point: Point) -> int:
    """How many parameters the last term has."""
    return len(point.hypothesis.terms[-1].effect.parameters)


def with_term(point: Point, term: Term, size: float) -> Point:
    """The point with one more term, its sizes at `size` medium ones."""
    sizes = [0.0 if p.shape else size for p in term.effect.parameters]
    return Point(point.hypothesis.with_term(term), point.nominal, np.concatenate([point.effect, sizes]))


def _collinear(
    model: Model, points: list[Point], at: int, sample: Sample, leading: np.ndarray
) -> Search[np.ndarray]:
    """(n,) how many times less sure the data alone are of coordinate `at` with each point's last term free.

    The nominal parameters are held: they may do what a rival does, and would hide it. leading : (D, W, T, C)
    derivatives by the coordinates before the last term, which does nothing yet.
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

"""Long lists of terms: one probe of each, and refits of the most promising ones only.

A robot with many joints has hundreds of terms. Each is simulated once per size parameter. From these probes the best
sizes and nominal parameters follow to first order. The most promising terms are tried at several sizes.
"""

from collections.abc import Iterable, Sequence
from itertools import zip_longest

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.hypothesis import SMALLEST, effect_bounds
from dynreg.evidence.likelihood import mean_squares, objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term

# bench_constants names three of three legs in the air, with the same evidence, with SIZES of one and of five, PULL of
# half and twice and PROBED of 8 and 32, in 29 and 50 s for 35 s.
PROBED = 16  # terms that are tried at several sizes,
SIZES = (0.5, 1.0, 2.0)  # these times what the probe says is best
# As much friction again, and joints stick: so refined, the double pendulum's shoulder has more of it than its elbow, 92
# nats beside the first cause (bench_diagnose_double_pendulum).
REFINED = 0.2  # of the medium size, for probes of what acts on joints already
PULL = 3.0  # largest first change of a nominal coordinate

Costed = list[tuple[float, Point]]


def promising(
    model: Model,
    base: Point,
    terms: Sequence[Term],
    sample: Sample,
    turned: bool = False,
    hints: Sequence[Point] = (),
) -> Search[tuple[list[Point], np.ndarray]]:
    """The most promising terms at their best tried size, the best first; and the derivatives (D, W, T, C) at `base`.

    turned : whether the cost of the probes themselves, with either sign, also ranks the terms. hints : `base` with
    likely terms, which are tried first, and at the sizes of the hints, too.
    """
    residual, (slope,) = yield from sensitivities(model, [base], sample)
    starts = yield from probed(model, base, terms, sample, residual[0], slope, turned)
    likely = {p.hypothesis.key for p in hints}
    starts.sort(key=lambda own: own[0].hypothesis.key not in likely)  # keeps the order otherwise
    points = [*hints, *(p for own in starts[:PROBED] for p in own)]
    cost = objective(points, (yield from model.residuals(points, sample)), sample)
    return best_of_each(zip(cost, points, strict=True)), slope


def probed(
    model: Model,
    base: Point,
    terms: Sequence[Term],
    sample: Sample,
    residual: np.ndarray,
    slope: np.ndarray,
    turned: bool,
) -> Search[list[list[Point]]]:
    """Of each term its points at several sizes, by first order; the most promising term first.

    residual : (W, T, C) of `base`. slope : (D, W, T, C) its derivatives. turned : as in `promising`.
    """
    probes = [_probes(base, term) for term in terms]
    tried = [p for own in probes for p in own]
    made = yield from model.residuals(tried, sample)
    linear = _Linear(model, base, residual, slope, sample)
    found, at = {}, 0
    for own in probes:
        found[own[0].hypothesis.key] = linear.starts(own, made[at : at + len(own)] - residual)
        at += len(own)
    order = sorted(found, key=lambda key: found[key][0])
    if not turned:
        return [found[key][1] for key in order]
    # contacts jump, and the first order may be wrong: the cost of the probes themselves, of either sign, counts as well
    cost = objective(tried, made, sample)
    other = [m for p in tried for m in mirrored(p)]
    if other:
        cost = np.append(cost, objective(other, (yield from model.residuals(other, sample)), sample))
    reached = {p.hypothesis.key: p for p in best_of_each(zip(cost, [*tried, *other], strict=True))}
    either = dict.fromkeys(key for pair in zip(order, reached, strict=True) for key in pair)
    return [[*found[key][1], reached[key]] for key in either]


def best_of_each(found: Iterable[tuple[float, Point]]) -> list[Point]:
    """The best point of each term, best first."""
    best: dict[str, Point] = {}
    for _, point in sorted(found, key=lambda d: d[0]):
        best.setdefault(point.hypothesis.key, point)
    return list(best.values())


def in_turn(first: Costed, second: Costed) -> list[Point]:
    """The best of the first and of the second in turn, each term once."""
    out: dict[str, Point] = {}
    for row in zip_longest(best_of_each(first), best_of_each(second)):
        for point in row:
            if point is not None:
                out.setdefault(point.hypothesis.key, point)
    return list(out.values())


def mirrored(point: Point) -> list[Point]:
    """The probe with the opposite sign; () if its sizes have none."""
    term = point.hypothesis.terms[-1]
    signed = np.array([p.signed for p in term.effect.parameters])
    effect = point.effect.copy()
    own = effect[len(effect) - len(signed) :]
    if not own[signed].any():
        return []
    own[signed] *= -1.0
    low, high = effect_bounds(point.hypothesis).T
    return [Point(point.hypothesis, point.nominal, np.clip(effect, low, high))]


def _probes(base: Point, term: Term) -> list[Point]:
    """`base` with the term at medium size, once for each size parameter alone; shapes at their typical value.

    An effect that already acts on some of these joints is probed at a smaller size.
    """
    hypothesis = base.hypothesis.with_term(term)
    parameters = term.effect.parameters
    same = [one.joints for one in base.hypothesis.terms if one.effect.id == term.effect.id]
    acting = any(not term.joints or not other or set(term.joints) & set(other) for other in same)
    size = REFINED if acting else 1.0
    low, high = effect_bounds(hypothesis)[-len(parameters) :].T
    nothing = np.array([0.0 if p.shape or p.signed else SMALLEST for p in parameters])
    out = []
    for i, p in enumerate(parameters):
        if p.shape:
            continue
        z = nothing.copy()
        z[i] = size
        out.append(Point(hypothesis, base.nominal, np.concatenate([base.effect, np.clip(z, low, high)])))
    return out


class _Linear:
    """The objective around a point, with a residual that is linear in all coordinates."""

    def __init__(self, model: Model, base: Point, residual: np.ndarray, slopes: np.ndarray, sample: Sample):
        self.model, self.base, self.residual, self.sample = model, base, residual, sample
        squares = mean_squares(residual[None], sample.data.floor)[0]
        weight = np.nan_to_num(sample.effective / squares) / max(residual.shape[1], 1)
        self.root = np.sqrt(np.broadcast_to(weight[:, None], residual.shape)).reshape(-1)
        self.flat = np.nan_to_num(slopes).reshape(len(slopes), -1) * self.root
        self.rest = np.nan_to_num(residual).reshape(-1) * self.root
        self.prior = base.prior
        self.slopes = slopes

    def starts(self, probes: list[Point], changes: np.ndarray) -> tuple[float, list[Point]]:
        """Objective at the best size, and points at `SIZES` times it. changes : (K, W, T, C) of the probes."""
        free = len(self.base.z)
        sized = [i for i, p in enumerate(probes[0].hypothesis.terms[-1].effect.parameters) if not p.shape]
        width = np.array([p.effect[len(self.base.effect) + i] for p, i in zip(probes, sized, strict=True)])
        scaled = np.nan_to_num(changes) / width[:, None, None, None]
        j = np.concatenate([self.flat, scaled.reshape(len(scaled), -1) * self.root])
        prior = np.concatenate([self.prior, np.zeros(len(sized))])
        curvature = j @ j.T + np.diag(prior + 1e-9)
        start = np.concatenate([self.base.z, np.zeros(len(sized))])
        best = np.linalg.lstsq(curvature, -j @ self.rest - prior * start, rcond=1e-12)[0]
        limits, own = bounds(self.model.coordinates, probes[0].hypothesis), [free + i for i in sized]
        out = []
        for share in SIZES:  # the other coordinates follow the size
            size = np.clip(share * best[free:], *limits[own].T)
            pull = -j[:free] @ (self.rest + size @ j[free:]) - self.prior * self.base.z
            move = np.linalg.lstsq(curvature[:free, :free], pull, rcond=1e-12)[0]
            move = np.clip(move, -PULL, PULL)
            z = probes[0].z.copy()
            z[:free] += move
            z[own] = size
            point = probes[0].moved(np.clip(z, *limits.T))
            after = self.residual + np.tensordot(size, scaled, 1) + np.tensordot(move, self.slopes, 1)
            out.append((float(objective([point], after[None], self.sample)[0]), point))
        return min(c for c, _ in out), [p for _, p in out]

"""Long lists of terms: one probe of each, and refits of the most promising ones only.

A robot with many joints has hundreds of terms. Each is simulated once per size parameter. From these probes the best
sizes and nominal parameters follow to first order. The most promising terms are tried at several sizes.
"""

from collections.abc import Iterable, Sequence
from itertools import zip_longest

import numpy as np

from dynreg.diagnose.linear import Linear, probes
from dynreg.evidence.data import Sample
from dynreg.evidence.hypothesis import effect_bounds
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term

# bench_constants names three of three legs in the air, with the same evidence, with 8 and 32, in 29 and 50 s for 35 s.
PROBED = 16  # terms that are tried at several sizes

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
    each = [probes(base, term) for term in terms]
    tried = [p for own in each for p in own]
    made = yield from model.residuals(tried, sample)
    linear = Linear(model, base, residual, slope, sample)
    found, at = {}, 0
    for own in each:
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

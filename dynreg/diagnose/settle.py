"""The end of a search: earlier causes chosen again in presence of later ones, and a last fit from several starts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynreg.diagnose.score import NEAR, Naming, Scored, score
from dynreg.evidence.data import Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, clipped
from dynreg.rng import stream
from dynreg.sim.effects import Term, one_group
from dynreg.sim.robot import Robot

# On bench_constants half of all names the same and errs by 4.6 % of a size, as they are by 5.6 %, twice by 5.5 %; TURNS
# of 1 and 4, SMALLER and SHAPES of half and twice by 5.4 to 5.7 %. Many starts are for real logs, where Stribeck's
# speed has local optima: five seeds end within 2.4 % of the error, 0.0337 to 0.0345 rad (bench_diagnose_servo).
SIMPLY = 4  # iterations of the last fit, each time, where one start is enough;
TURNS = 2  # times that what the time step does is found anew,
FINELY = 2  # by so many iterations each time, where there were several starts
SMALLER = (0.2, 1.0)  # times the size that an effect has, where a start begins
SHAPES = 0.5  # of the prior's standard deviation, by which shapes are drawn about the usual one
STARTS = 10  # of the last fit, the point that the search ended with among them
KEPT = 3  # of them that are fitted to the end,
ROUGHLY, FULLY = 3, 12  # after so many iterations, by so many
ENOUGH = 0.05  # nats that an iteration must gain for another one
AGAIN = 6  # iterations of an equivalent in the place of a cause


def unlike(robot: Robot, terms: Sequence[Term], accepted: tuple[Term, ...]) -> list[Term]:
    """The terms that are neither accepted nor in the exact group of an accepted one."""
    return [t for t in terms if not any(t.key == a.key or one_group(robot, t, a) for a in accepted)]


def revise(model: Model, rounds: Sequence[Naming], sample: Sample) -> Search[list[Naming]]:
    """The rounds with an earlier cause replaced by an equivalent that explains more together with the later causes.

    A choice that is open with one cause (Stribeck or plain load friction) may be decided with the next. An equivalent
    must gain `NEAR` of the whole evidence, as in every choice, and once more for each additional parameter: on real
    logs every shape gains something from effects that no library has. sample : the windows to fit.
    """
    rounds = list(rounds)
    for number in range(len(rounds) - 1):
        current = rounds[-1].chosen
        at = current.point.hypothesis.given + number
        others = _equivalents_in_place(model.robot, current.point, rounds[number], at)
        if not others:
            continue
        fitted, _ = yield from fit(model, [p for _, p in others], sample, iterations=AGAIN)
        naming = yield from score(model, sample.data, current.point, fitted)
        rounds = exchange_cause(rounds, number, others, naming.ranking)
    return rounds


def exchange_cause(
    rounds: list[Naming], number: int, others: list[tuple[Scored, Point]], ranking: list[Scored]
) -> list[Naming]:
    """The rounds with the cause of round `number` replaced by the best equivalent, if one gains enough.

    others : each equivalent, and the last point with it in place of the cause. ranking : these points refitted, by
    their gain over the last one [nats].
    """
    total = sum(r.chosen.nats for r in rounds)
    effect = rounds[-1].chosen.point.effect
    more = [max(len(s.point.effect) - len(effect), 0) for s in ranking]
    better = [s for s, m in zip(ranking, more, strict=True) if s.nats > NEAR * total * (1 + m)]
    if not better:
        return rounds
    other = next(s for s, point in others if point.hypothesis.key == better[0].key)
    naming, out = rounds[number], list(rounds)
    rest = (s for s in naming.equivalent if s is not other)
    out[number] = replace(naming, chosen=other, equivalent=(naming.chosen, *rest))
    for later in range(number + 1, len(rounds)):
        scored = rounds[later].chosen
        point = better[0].point
        if later < len(rounds) - 1:
            between = _put_in_place(scored.point, scored.point.hypothesis.given + number, other.point)
            point = replace(between, nominal=point.nominal)
        out[later] = replace(rounds[later], chosen=replace(scored, point=point))
    return out


def settle(model: Model, point: Point, sample: Sample, *, seed: int = 0) -> Search[tuple[Model, Point]]:
    """The corrected model, and the point refitted on a sample from several starts.

    Shapes of effects have local optima, and the first cause may still stand in for later ones. The other starts draw
    the nominal parameters and shapes from their priors, with smaller effects. One cause without a shape needs no
    further starts.
    """
    simple = len(point.hypothesis.terms) == 1 and not any(p.shape for p in point.hypothesis.parameters)
    if simple:
        return (yield from _finely(model, point, sample, iterations=SIMPLY))
    starts = [point, *_drawn_anew(model, point, stream(seed, "settle", point.hypothesis.key))]
    rough, cost = yield from fit(model, starts, sample, iterations=ROUGHLY)
    best = best_of(rough, cost, KEPT)
    sample = sample.reweighted((yield from model.residuals(best[:1], sample))[0])
    fitted, cost = yield from fit(model, best, sample, iterations=FULLY, tolerance=ENOUGH)
    return (yield from _finely(model, best_of(fitted, cost)[0], sample, iterations=FINELY))


def _finely(model: Model, point: Point, sample: Sample, iterations: int) -> Search[tuple[Model, Point]]:
    """The point refitted, then again with the model corrected for the time step at the new point."""
    known: dict[Point, np.ndarray] = {}
    for _ in range(TURNS):
        (point,), _ = yield from fit(model, [point], sample, iterations=iterations, known=known)
        model = yield from model.corrected([point], sample.data)
    (point,), _ = yield from fit(model, [point], sample, iterations=iterations, known=known)
    return model, point


def _drawn_anew(model: Model, point: Point, rng: np.random.Generator) -> list[Point]:
    """Random starts of the last fit besides the point itself."""
    shapes = np.array([p.shape for p in point.hypothesis.parameters], dtype=bool)
    out = []
    for _ in range(STARTS - 1):
        nominal = rng.standard_normal(len(point.nominal))
        smaller = point.effect * rng.uniform(*SMALLER, len(point.effect))
        effect = np.where(shapes, SHAPES * rng.standard_normal(len(point.effect)), smaller)
        out.append(clipped(model.coordinates, point, np.concatenate([nominal, effect])))
    return out


def _equivalents_in_place(
    robot: Robot, point: Point, naming: Naming, number: int
) -> list[tuple[Scored, Point]]:
    """(equivalent, start) with term `number` of the point replaced by each equivalent of its round."""
    terms = point.hypothesis.terms
    out = []
    for other in naming.equivalent:
        if unlike(robot, [other.point.hypothesis.terms[-1]], terms[:number] + terms[number + 1 :]):
            made = _put_in_place(point, number, other.point)
            out += [(other, replace(made, nominal=z)) for z in (point.nominal, other.point.nominal)]
    return out


def _put_in_place(point: Point, number: int, other: Point) -> Point:
    """The point with term `number` replaced by the last term of `other`, at its sizes there."""
    hypothesis, last = point.hypothesis, other.hypothesis.terms[-1]
    terms, own = hypothesis.terms, hypothesis.columns(number)
    sizes = other.effect[len(other.effect) - len(last.effect.parameters) :]
    return Point(
        replace(hypothesis, terms=(*terms[:number], last, *terms[number + 1 :])),
        point.nominal,
        np.concatenate([point.effect[: own.start], sizes, point.effect[own.stop :]]),
    )

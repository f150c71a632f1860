"""Contact: many joints, and feet that touch the ground; rough rollouts tell what is near, fine ones what is right."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.plans.polish import polish
from dynreg.diagnose.score import Naming, score
from dynreg.diagnose.shortlist import PROBED, Costed, best_of_each, promising
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Contact(Plan):
    """Rollouts in which contacts come and go.

    Nominal parameters that made up for a cause are hard to walk back: half of the terms that are refitted start from
    the nameplate. Their refit is only begun: the finer time step ends it elsewhere. The search with these numbers named
    105 of 120 fresh legs on the ground, in 45 s each (bench_naming_leg).

    behind : nats behind the best of its own start, by the finer time step, from which a term is not refitted with it.
    again : iterations of the model without a term, and of it from where the best ended. fine : terms that are refitted
    with the finer time step by one iteration with shared derivatives, finished : those of them that are polished with
    their own, by `polished` iterations. last : iterations of the last fit: each simulates the finer time step.
    """

    behind: float = 40.0
    again: int = 2
    fine: int = 8
    finished: int = 3
    polished: int = 3
    last: int = 2

    def name(
        self,
        model: Model,
        base: Point,
        terms: Sequence[Term],
        sample: Sample,
        hints: Sequence[Point] = (),
    ) -> Search[tuple[Naming, Model]]:
        if base.hypothesis.keys not in model.corrections:
            model = yield from model.corrected([base], sample.data)
        nameplate = Point(base.hypothesis, np.zeros(len(base.nominal)), base.effect)
        found: Costed = []
        for start in (base, nameplate):
            found += yield from begun(model, start, terms, sample, self.behind)
        fitted = best_of_each(found)
        others = [base, *stripped(base, fitted[:1])]
        again, price = yield from fit(model, others, sample, iterations=self.again)
        start, fitted = yield from self._finished(model, best_of(again, price)[0], fitted, sample)
        return (yield from score(model.fine, sample.data, start, fitted)), model

    def _finished(
        self, model: Model, start: Point, fitted: list[Point], sample: Sample
    ) -> Search[tuple[Point, list[Point]]]:
        """The model without the term and those with it, refitted with finer time steps, best first.

        The model without the term starts where one of them ended, too, and is chosen as they are: by all windows.
        """
        fine, fitted = model.fine, fitted[: self.fine]
        (residual,), (slope,) = yield from sensitivities(fine, fitted[:1], sample)
        shared = {"leading": slope[: len(start.nominal)], "iterations": 1}
        fitted, cost = yield from fit(fine, fitted, sample.reweighted(residual), **shared)
        first = [start, *best_of(fitted, cost, self.finished)]
        how = {"iterations": self.polished}
        (start, *fitted), residuals = yield from polish(model, first, sample, hopeless=self.hopeless, **how)
        fitted = best_of(fitted, objective(fitted, residuals[1:], sample.reweighted(residuals[1])))
        every = sample.data.sample(sample.data.both)
        rival = yield from _best(fine, stripped(start, fitted), every)
        (rival,), _ = yield from polish(model, [rival], sample, **how)
        return (yield from _best(fine, [start, rival], every)), fitted

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        """The finer time step is simulated at every point: what it changes is not the same from one to the next, and
        the causes must not gain by it. Together they take less time: most of a fine rollout goes to the steps.
        """
        data, model = state.data, state.model
        old, new = posed.sample(posed.both), data.sample(data.both)
        how = {"iterations": self.last}
        if not state.accepted:
            (base,), _ = yield from polish(model, [state.base], old, **how)
            current = base
        elif data is posed:
            (base, current), _ = yield from polish(model, [state.base, state.current], old, **how)
        else:
            (base,), _ = yield from polish(model, [state.base], old, **how)
            (current,), _ = yield from polish(model, [state.current], new, **how)
        model = yield from model.corrected([current], data)
        return replace(state, model=model, base=base, current=current)


def begun(
    model: Model,
    start: Point,
    terms: Sequence[Term],
    sample: Sample,
    behind: float = np.inf,
    ahead: tuple[int, int] = (0, 0),
) -> Search[Costed]:
    """Objective, by the finer time step, and point of each of the most promising terms after one step of its refit.

    What the time step does to the start flatters all that stays near it: only the finer one judges.
    behind : nats behind the best from which a term is left out. ahead : how many of the best go on, with derivatives
    of their own, and by how many iterations.
    """
    points, slope = yield from promising(model, start, terms, sample, turned=True)
    points, cost = yield from fit(model, points[: PROBED // 2], sample, iterations=1, leading=slope)
    count, iterations = ahead
    if iterations:
        points = best_of(points, cost)
        further, _ = yield from fit(model, points[:count], sample, iterations=iterations)
        points = [*further, *points[count:]]
    cost = objective(points, (yield from model.fine.residuals(points, sample)), sample)
    return [(float(c), p) for c, p in zip(cost, points, strict=True) if c <= cost.min() + behind]


def _best(model: Model, points: Sequence[Point], sample: Sample) -> Search[Point]:
    """The point with the lowest objective, by the independent samples of the first."""
    residuals = yield from model.residuals(points, sample)
    return best_of(points, objective(points, residuals, sample.reweighted(residuals[0])))[0]

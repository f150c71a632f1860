"""Feet: a floating base that stands on its feet and forgets where it started once one of them slips."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynreg.diagnose.plans.contact import begun
from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.score import Naming, by_either, score
from dynreg.diagnose.shortlist import Costed, in_turn
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Feet(Plan):
    """Terms start in turn from the nameplate and from the calibrated model; then all are fitted on all windows, finely.

    On half of the windows wrong causes fit what disturbs them better than the true one does, and the usual time step's
    derivatives stop far from the optimum, that of the model without the term above all: what it lacks any cause gains.
    The search with these numbers named 37 of 50 fresh quadrupeds and none of 20 without an effect, in 122 s each
    (bench_naming_quadruped); those of terms and iterations are what two minutes allow.

    ahead : terms from the nameplate that go on, and by how many iterations: none of many nominal parameters is fitted
        there yet, and one shared step leaves all terms about as bad. A cause that nominal parameters can make up for is
        found from there, one in a single joint from the calibrated model. behind : as in `Contact`, of the latter.
    clear : nats ahead of the calibrated model, from which what starts at the nameplate needs nothing beside it.
    gained : nats, by the finer time step, that a term from the calibrated model must have gained.
    standing : of terms, by the finer time step: how many take a step on the windows to fit, how many of them one on all
        windows, how many of these go on by `more` iterations. away : nats behind the best, from which none goes on.
    chaos : nats that an iteration must gain for another one: less is a foot that slips a moment earlier.
    alone, rival : iterations of the model without a term, and of it from where the best ended.
    alike : what a foot that slips a moment earlier changes is larger than what a cause does. Of 1,000 simulators with
        one effect each the nearest carried the hidden cause for 1 of 41 robots (bench_ranker).
    """

    alike: ClassVar[bool] = False
    ahead: tuple[int, int] = (5, 3)
    behind: float = 40.0
    clear: float = 300.0
    gained: float = 20.0
    standing: tuple[int, int, int] = (6, 4, 3)
    more: int = 3
    away: float = 300.0
    chaos: float = 5.0
    alone: int = 4
    rival: int = 2

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
        fitted = yield from self._listed(model, base, terms, sample)
        start, fitted = yield from self._stood(model.fine, base, fitted, sample)
        return (yield from score(model.fine, sample.data, start, fitted, by_either)), model

    def _listed(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample
    ) -> Search[list[Point]]:
        """The terms to go on with, from the nameplate and from the calibrated model in turn."""
        nameplate = Point(base.hypothesis, np.zeros(len(base.nominal)), base.effect)
        ahead = yield from begun(model, nameplate, terms, sample, ahead=self.ahead)
        without = objective([base], (yield from model.fine.residuals([base], sample)), sample)[0]
        near: Costed = []
        if min(cost for cost, _ in ahead) >= without - self.clear:
            near = yield from begun(model, base, terms, sample, self.behind)
        return in_turn(ahead, [(cost, point) for cost, point in near if cost < without - self.gained])

    def _stood(
        self, fine: Model, start: Point, fitted: list[Point], sample: Sample
    ) -> Search[tuple[Point, list[Point]]]:
        """The model without the term and those with it, fitted finely on all windows, best first."""
        first, second, third = self.standing
        every = sample.data.sample(sample.data.both)
        every = every.reweighted((yield from fine.residuals([start], every))[0])
        fitted, _ = yield from fit(fine, fitted[:first], every.take(len(sample.chosen)), iterations=1)
        fitted = yield from _sorted(fine, fitted, every)
        fitted, cost = yield from fit(fine, fitted[:second], every, iterations=1)
        fitted = best_of(fitted, cost)
        close = min(int((cost <= cost.min() + self.away).sum()), third)
        more = {"iterations": self.more, "hopeless": self.hopeless}
        ahead, _ = yield from fit(fine, fitted[:close], every, tolerance=self.chaos, **more)
        fitted = yield from _sorted(fine, [*ahead, *fitted[close:]], every)
        (start,), _ = yield from fit(fine, [start], every, iterations=self.alone, tolerance=self.chaos)
        (rival,), _ = yield from fit(
            fine, stripped(start, fitted[:1]), every, iterations=self.rival, tolerance=self.chaos
        )
        return (yield from _sorted(fine, [start, rival], every))[0], fitted

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        """Fitted on all windows already; a last round that found no more has gone on with the current simulator."""
        more = len(state.rounds) > state.accepted
        current = state.rounds[-1].start.point if more else state.current
        model = yield from state.model.corrected([current], state.data)
        return replace(state, model=model, current=current)


def _sorted(model: Model, points: Sequence[Point], sample: Sample) -> Search[list[Point]]:
    """The points by their objective, the best first."""
    return best_of(points, objective(points, (yield from model.residuals(points, sample)), sample))

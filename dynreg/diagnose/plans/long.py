"""Long: many joints, hundreds of terms; each is probed, few are refitted, fewer to the end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.score import Naming, score
from dynreg.diagnose.shortlist import best_of_each, promising
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Long(Plan):
    """More than two joints whose rollouts are smooth.

    halved : iterations of the rounds after each of which half as many terms are left. rivals, again : of the best from
    where the model without a term is fitted again, and by how many iterations. rounds, better : as in `Short`.
    last : iterations of the calibrated simulator's last fit; the extended one's are `ends` rounds of twice that.
    """

    halved: tuple[int, ...] = (1, 1)
    rivals: int = 1
    again: int = 2
    rounds: int = 2
    better: float = 2.0
    last: int = 1
    ends: int = 2

    def name(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample
    ) -> Search[tuple[Naming, Model]]:
        for _ in range(self.rounds):
            model, fitted = yield from self._refitted(model, base, terms, sample)
            others = [base, *stripped(base, fitted[: self.rivals])]
            again, price = yield from fit(model, others, sample, iterations=self.again)
            base = best_of(again, price)[0]
            naming = yield from score(model, sample.data, base, fitted)
            if not naming.ranking or price[0] - price.min() <= self.better:
                break
            terms = [scored.point.hypothesis.terms[-1] for scored in naming.ranking]  # the best stay the best
        return naming, model

    def _refitted(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample
    ) -> Search[tuple[Model, list[Point]]]:
        """The most promising terms, the best of them fitted to the end, best first; and the model, corrected there."""
        points, slope = yield from promising(model, base, terms, sample)
        done: list[tuple[float, Point]] = []
        for number in self.halved:
            points, cost = yield from fit(model, points, sample, iterations=number, leading=slope)
            order = np.argsort(cost, kind="stable")
            half = (len(order) + 1) // 2
            done += [(float(cost[i]), points[i]) for i in order[half:]]
            points = [points[i] for i in order[:half]]
        # the best have moved away from the calibrated model: derivatives and the time step's part anew, where they are
        model = yield from model.corrected(points, sample.data)
        _, (slope,) = yield from sensitivities(model, points[:1], sample)
        last = {"leading": slope[: len(base.z)], "hopeless": self.hopeless}
        points, cost = yield from fit(model, points, sample, iterations=self.iterations, **last)
        return model, best_of_each(done + [(float(c), p) for c, p in zip(cost, points, strict=True)])

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        model, current, pooled = state.model, state.current, state.pooled
        (base,), _ = yield from fit(model, [state.base], replace(pooled, data=posed), iterations=self.last)
        if not state.accepted:
            return replace(state, base=base, current=base)
        for _ in range(self.ends):
            model = yield from model.corrected([current], pooled.data, pooled.chosen)
            (residual,) = yield from model.residuals([current], pooled)
            (current,), _ = yield from fit(model, [current], pooled.left(residual), iterations=2)
        return replace(state, model=model, base=base, current=current)

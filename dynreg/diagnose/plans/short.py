"""Short: few terms, cheap rollouts; every term is screened, and the best are refitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.score import Naming, score
from dynreg.diagnose.screen import screen
from dynreg.diagnose.settle import settle
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Short(Plan):
    """At most two joints, or few effects.

    finalists : points that are fitted to the end: the best of each hypothesis, and others where there is room.
    rivals : of them from where the model without a term is fitted again. rounds : of naming, where the first found a
    model without the term that is `better` [nats] on its way. last : iterations of the calibrated simulator's last fit.
    """

    draws: int = 4
    finalists: int = 16
    rivals: int = 3
    rounds: int = 2
    better: float = 2.0
    last: int = 4

    def name(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample
    ) -> Search[tuple[Naming, Model]]:
        for _ in range(self.rounds):
            fitted = yield from self._refitted(model, base, terms, sample)
            others = [base, *stripped(base, fitted[: self.rivals])]
            again, price = yield from fit(model, others, sample, iterations=self.iterations)
            base = best_of(again, price)[0]
            naming = yield from score(model, sample.data, base, fitted)
            if not naming.ranking or price[0] - price.min() <= self.better:
                break
        return naming, model

    def _refitted(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample
    ) -> Search[list[Point]]:
        """The finalists, fitted to the end."""
        starts, slope = yield from screen(model, base, terms, sample)
        rough, cost = yield from fit(model, starts, sample, iterations=1, leading=slope)
        ordered, first = best_of(rough, cost), {}
        for point in ordered:
            first.setdefault(point.hypothesis.key, point)
        # the best start of each hypothesis, best first; then the others
        best = list(first.values())
        best += [point for point in ordered if first[point.hypothesis.key] is not point]
        last = {"iterations": self.iterations, "hopeless": self.hopeless}
        fitted, _ = yield from fit(model, best[: self.finalists], sample, **last)
        return fitted

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        pooled = state.pooled
        (base,), _ = yield from fit(
            state.model, [state.base], replace(pooled, data=posed), iterations=self.last
        )
        if not state.accepted:
            return replace(state, base=base, current=base)
        model, current = yield from settle(state.model, state.current, pooled, seed=seed)
        return replace(state, model=model, base=base, current=current)

"""Short: few terms; every one is screened, and the best are refitted."""

from collections.abc import Sequence
from dataclasses import dataclass

from dynreg.diagnose.plans.smooth import Smooth
from dynreg.diagnose.score import Naming
from dynreg.diagnose.screen import screen
from dynreg.diagnose.settle import settle
from dynreg.evidence.data import Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Short(Smooth):
    """At most two joints, or few effects.

    finalists : points that are fitted to the end: the best of each hypothesis, and others where there is room. On
        bench_constants 8 and 32 name the same, with 2646 and 2738 nats for 2646, in 15.7 and 27.4 s for 18.2 s.
    """

    draws: int = 4
    finalists: int = 16

    @property
    def fitted(self) -> int:
        return self.finalists

    def refitted(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample, hints: Sequence[Point]
    ) -> Search[tuple[Model, list[Point]]]:
        starts, slope = yield from screen(model, base, terms, sample, hints)
        begun, cost = yield from fit(model, starts, sample, iterations=1, leading=slope)
        ordered, first = best_of(begun, cost), {}
        for point in ordered:
            first.setdefault(point.hypothesis.key, point)
        # the best start of each hypothesis, likely ones first, then by cost; then the others
        likely = dict.fromkeys(point.hypothesis.key for point in hints)
        best = [first[key] for key in dict.fromkeys([*likely, *first])]
        best += [point for point in ordered if first[point.hypothesis.key] is not point]
        last = {"iterations": self.iterations, "hopeless": self.hopeless}
        fitted, _ = yield from fit(model, best[: self.finalists], sample, **last)
        return model, fitted

    def remaining(self, terms: Sequence[Term], naming: Naming) -> Sequence[Term]:
        return terms

    def ended(self, model: Model, point: Point, sample: Sample, seed: int) -> Search[tuple[Model, Point]]:
        return settle(model, point, sample, seed=seed)

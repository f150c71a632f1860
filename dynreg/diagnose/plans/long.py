"""Long: many joints, hundreds of terms; each is probed, few are refitted, fewer to the end."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.plans.smooth import Smooth
from dynreg.diagnose.score import Naming
from dynreg.diagnose.shortlist import Costed, best_of_each, promising
from dynreg.evidence.data import Sample
from dynreg.evidence.fit import fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Long(Smooth):
    """More than two joints whose rollouts are smooth.

    halved : iterations of the rounds after each of which half as many terms are left. ends : rounds of the last fit,
    each of `again` iterations. On bench_constants three of three legs in the air are named, with 586 nats, with two
    iterations in each round of `halved`, and with half and twice of `hopeless`, `iterations`, `again`, `rivals` and
    `rounds`; with one round of `halved` with 573. `last` and `ends` of one err by 3.2 % of a size, as they are 4.5 %.
    The table of legs in the air was made with all of it: 114 of 120 named, in 18 s each (bench_naming_leg).
    """

    rivals: int = 1
    again: int = 2
    last: int = 1
    halved: tuple[int, ...] = (1, 1)
    ends: int = 2

    def refitted(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample, hints: Sequence[Point]
    ) -> Search[tuple[Model, list[Point]]]:
        points, slope = yield from promising(model, base, terms, sample, hints=hints)
        done: Costed = []
        for iterations in self.halved:
            points, cost = yield from fit(model, points, sample, iterations=iterations, leading=slope)
            order = np.argsort(cost, kind="stable")
            half = (len(order) + 1) // 2
            done += [(float(cost[i]), points[i]) for i in order[half:]]
            points = [points[i] for i in order[:half]]
        # the best have moved away from the calibrated model: derivatives and the time step's part anew, where they are
        if model.accuracy.order == 1:
            model = yield from model.corrected(points, sample.data)
        _, (slope,) = yield from sensitivities(model, points[:1], sample)
        last = {"leading": slope[: len(base.z)], "hopeless": self.hopeless}
        points, cost = yield from fit(model, points, sample, iterations=self.iterations, **last)
        return model, best_of_each(done + [(float(c), p) for c, p in zip(cost, points, strict=True)])

    def remaining(self, terms: Sequence[Term], naming: Naming) -> Sequence[Term]:
        return [scored.point.hypothesis.terms[-1] for scored in naming.ranking]  # the best stay the best

    def ended(self, model: Model, point: Point, sample: Sample, seed: int) -> Search[tuple[Model, Point]]:
        for _ in range(self.ends):
            model = yield from model.corrected([point], sample.data)
            (residual,) = yield from model.residuals([point], sample)
            (point,), _ = yield from fit(model, [point], sample.reweighted(residual), iterations=self.again)
        return model, point

"""What plans of smooth rollouts share: rounds of naming, and the last fit on fit and select together."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.score import INSTEAD, PER_PARAMETER, Naming, Scored, lowered, score
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term

TRIED = 3  # hypotheses that are fitted to both parts: by contract


@dataclass(frozen=True)
class Smooth(Plan):
    """Where small differences of a simulator make small differences of its rollouts, and short lists where they do not:
    the verdict then looks at finer rollouts, the scores do not.

    iterations : of refits to the end; two have 2630 nats on bench_constants where five have 2646.
    rivals, again : of the best from where the model without a term is fitted again, and by how many iterations: it gets
    the same chance. rounds : of naming, where the first found a model without the term that is `better` [nats] on its
    way. last : iterations of the calibrated simulator's last fit. On bench_constants half and twice of `rivals` and
    `rounds`, of `better`, of `again` and of `last` name the same.
    """

    iterations: int = 5
    rivals: int = 3
    again: int = 5
    rounds: int = 2
    better: float = 2.0
    last: int = 4

    def name(
        self,
        model: Model,
        base: Point,
        terms: Sequence[Term],
        sample: Sample,
        hints: Sequence[Point] = (),
    ) -> Search[tuple[Naming, Model]]:
        for _ in range(self.rounds):
            model, fitted = yield from self.refitted(model, base, terms, sample, hints)
            others = [base, *stripped(base, fitted[: self.rivals])]
            again, price = yield from fit(model, others, sample, iterations=self.again)
            base = best_of(again, price)[0]
            naming = yield from score(model, sample.data, base, fitted)
            if not naming.ranking or price[0] - price.min() <= self.better:
                break
            terms = self.remaining(terms, naming)
        naming = yield from fitted_to_both(model, naming, sample.data, self.iterations)
        return naming, model

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        pooled = state.pooled
        before = replace(pooled, data=posed)
        (base,), _ = yield from fit(state.model, [state.base], before, iterations=self.last)
        state = replace(state, base=base)
        if not state.accepted:
            return replace(state, current=base)
        model, current = yield from self.ended(state.model, state.current, pooled, seed)
        return replace(state, model=model, current=current)

    @abstractmethod
    def remaining(self, terms: Sequence[Term], naming: Naming) -> Sequence[Term]:
        """The terms of the next round."""

    @abstractmethod
    def refitted(
        self, model: Model, base: Point, terms: Sequence[Term], sample: Sample, hints: Sequence[Point]
    ) -> Search[tuple[Model, list[Point]]]:
        """`base` with one of the terms, fitted to the end, the best first; and the model, corrected there."""

    @abstractmethod
    def ended(self, model: Model, point: Point, sample: Sample, seed: int) -> Search[tuple[Model, Point]]:
        """The last fit of the simulator with the causes; and the model, corrected there."""


def fitted_to_both(model: Model, naming: Naming, data: Data, iterations: int) -> Search[Naming]:
    """The naming without the evidence that parameters win back once the simulators are fitted to the select part, too,
    where that is more than `INSTEAD` of it.

    The select part judges simulators that were fitted without it. A parameter that the fit part hardly holds can cost
    one of them tens of nats there (a joint that sticks in one window more, say), and no cause is needed for these. Of
    60 simulated servos without a cause one scored 21 nats so, and with this rule none above 0. Where the chosen
    hypothesis loses so, the next ones are fitted again, too, `TRIED` of all, and another may be chosen.
    """
    if naming.chosen is None:
        return naming
    start, chosen = naming.start.point, naming.chosen
    both = data.sample(data.both)
    (residual,) = yield from model.residuals([chosen.point], both)
    both = both.reweighted(residual)
    points = [chosen.point, start, *stripped(start, [chosen.point])]
    _, (own, *plain) = yield from fit(model, points, both, iterations=iterations)
    back = won_back(chosen, start, min(plain) - own)
    if back <= INSTEAD * abs(chosen.nats):
        return naming
    less = {chosen.key: back}
    others = [s for s in naming.ranking if s is not chosen][: TRIED - 1]
    if not others:
        return lowered(naming, less)
    _, cost = yield from fit(model, [s.point for s in others], both, iterations=iterations)
    for scored, reached in zip(others, cost, strict=True):
        back = won_back(scored, start, min(plain) - reached)
        if back > INSTEAD * abs(scored.nats):
            less[scored.key] = back
    return lowered(naming, less)


def won_back(scored: Scored, start: Point, gain: float) -> float:
    """Nats of a hypothesis that are not left of what it gains over `start` where both are fitted to both parts."""
    price = PER_PARAMETER * (len(scored.point.effect) - len(start.effect))
    return scored.nats - float(gain - price)

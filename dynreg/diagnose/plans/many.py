"""Many: a robot on its feet with many parameters, where most of a search would go into derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynreg.diagnose.plans.plan import Plan, State, stripped
from dynreg.diagnose.score import Naming, by_either, score
from dynreg.diagnose.screen import screen
from dynreg.diagnose.shortlist import best_of_each
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term


@dataclass(frozen=True)
class Many(Plan):
    """Terms are listed at the calibrated model. The likeliest are fitted from there, on all windows.

    Many parameters make up for much: a term shows what it explains only after they have moved. On two AIBOs with
    slippery elbows (38 parameters, 12 walks of 2 s) the elbows' material gains 517 and 822 nats.
    finalists : how many terms are fitted beside the calibrated model. iterations, rival : of these, and of the model
    without the term from where the best ended.
    """

    alike: ClassVar[bool] = False
    finalists: int = 2
    iterations: int = 12
    rival: int = 6

    @property
    def fitted(self) -> int:
        return 1  # derivatives of most steps are carried on

    def name(
        self,
        model: Model,
        base: Point,
        terms: Sequence[Term],
        sample: Sample,
        hints: Sequence[Point] = (),
    ) -> Search[tuple[Naming, Model]]:
        starts, slope = yield from screen(model, base, terms, sample, hints)
        begun, cost = yield from fit(model, starts, sample, iterations=1, leading=slope)
        likely = best_of_each(zip(cost, begun, strict=True))[: self.finalists]
        every = sample.data.sample(sample.data.both)
        every = every.reweighted((yield from model.residuals([base], every))[0])
        known: dict[Point, np.ndarray] = {}
        rows, cost = yield from fit(model, [base, *likely], every, iterations=self.iterations, known=known)
        fitted = best_of_each(zip(cost[1:], rows[1:], strict=True))
        (rival,) = stripped(base, fitted[:1])
        if fitted[0] in known:
            known[rival] = known[fitted[0]][: len(rival.z)]
        again, price = yield from fit(model, [rival], every, iterations=self.rival, known=known)
        start = best_of([rows[0], *again], np.append(cost[:1], price))[0]
        return (yield from score(model, sample.data, start, fitted, by_either)), model

    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        """Fitted on all windows already; a last round that found no more has gone on with the current simulator.

        Both simulators are judged and stored with the robot's own time step. A last fit by that step made neither
        better on the two AIBOs above.
        """
        yield from ()  # a search that asks for no rollouts
        more = len(state.rounds) > state.accepted
        return replace(state, current=state.rounds[-1].start.point if more else state.current)

"""The nearest of registered simulators (paper D), and a simulator made of them, as `dynreg query` makes it."""

from typing import ClassVar

import numpy as np

from dynreg.distance.population import Population
from dynreg.errors import UsageError
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question, episodes_of, seconds_of
from dynreg.neighbours.query import Case, Choice, choose, distance_query
from dynreg.neighbours.retrieve import retrieve
from dynreg.neighbours.spending import Spending, usual_budget
from dynreg.replay.windows import Replayer

K = 5  # neighbours, as in paper D


class Nearest:
    """The best by replay of the entries whose dynamics look most like the recording's (paper D)."""

    synthesise: ClassVar[bool] = False

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """The entry as a version. Raises UsageError where the simulations do not suffice for `K` neighbours."""
        data, population = question.data, evidence.population
        replayer = Replayer(data.robot, data.windows, limits.threads)
        case = Case(population, data, replayer, limits.progress or (lambda *_: None))
        k = min(K, len(population))
        budget = limits.simulations or usual_budget(data.robot, k)
        if budget < k + 2:
            raise UsageError(
                f"a budget of {budget} simulations",
                expected=f"at least {k + 2}, for {k} neighbours",
                do="raise --budget",
            )
        spending = Spending(k, budget, replay=True, synthesise=self.synthesise)
        rows = distance_query(case, spending)
        found = retrieve(rows, guess=self.synthesise)
        choice = choose(case, found, spending)
        return Answer(
            self._versions(question, choice, population),
            "budget",
            choice.rollouts,
            choice.rollouts * seconds_of(question),
            evaluations=found.ranked.evaluations,
            free=question.free,
            intervals={name: (one.low, one.high) for name, one in choice.intervals.items()},
        )

    def _versions(self, question: Question, choice: Choice, population: Population) -> tuple[Version, ...]:
        values, score = question.data.values_of(choice.replays.unit), choice.replays.score
        entry = population.entries.ids[choice.candidates[choice.best].entry]
        nearest = Version(
            "nearest",
            values[choice.best],
            None,
            episodes_of(question),
            float(score[0]),
            float(score[choice.best]),
            entry,
        )
        if not self.synthesise or choice.made is None or not np.isfinite(score[choice.made]):
            return (nearest,)
        after = float(score[choice.made])
        made = Version("synthesis", values[choice.made], 0, nearest.episodes, nearest.after, after)
        return (nearest, made)


class Synthesis(Nearest):
    """The simulator that a query makes of the nearest ones; the best of these where it makes none."""

    synthesise: ClassVar[bool] = True

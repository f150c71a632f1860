"""The nearest of registered simulators, and one made of them: papers D's way, and what a query adds."""

from typing import ClassVar

import numpy as np

from dynreg.adapt.version import Fitted, Version
from dynreg.methods.calibrator import Evidence, Limits, Question, episodes_of, seconds_of
from dynreg.neighbours.query import Case, Choice, choose, distance_query
from dynreg.neighbours.retrieve import retrieve
from dynreg.neighbours.spending import Spending, usual_budget
from dynreg.replay.windows import Replayer

K = 5  # neighbours, as in paper D


class Nearest:
    """The best by replay of the entries whose dynamics look most like the recording's (paper D)."""

    needs: ClassVar[tuple[str, ...]] = ("population",)
    synthesise: ClassVar[bool] = False

    def __init__(self, name: str):
        self._name = name

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Fitted:
        """The entry as a version. Raises UsageError where the simulations do not suffice for `K` neighbours."""
        data, population = question.data, evidence.population
        replayer = Replayer(data.robot, data.windows, limits.threads)
        case = Case(population, data, replayer, limits.progress or (lambda *_: None))
        k = min(K, len(population))
        budget = limits.simulations or usual_budget(data.robot, k)
        spending = Spending(k, budget, replay=True, synthesise=self.synthesise)
        rows = distance_query(case, None, k)
        found = retrieve(rows, guess=self.synthesise)
        choice = choose(case, found, spending)
        return Fitted(
            self._versions(question, choice),
            "budget",
            choice.rollouts,
            choice.rollouts * seconds_of(question),
            evaluations=found.ranked.evaluations,
            intervals={name: (one.low, one.high) for name, one in choice.intervals.items()},
        )

    def _versions(self, question: Question, choice: Choice) -> tuple[Version, ...]:
        return (self._version(question, choice, "nearest", choice.best, None, 0),)

    def _version(
        self, question: Question, choice: Choice, stage: str, which: int, parent: int | None, before: int
    ) -> Version:
        """The simulator `which` of those that were replayed; `before` : the one that it is held against."""
        values = question.data.values_of(choice.replays.unit)[which]
        score = choice.replays.score
        return Version(
            stage, values, parent, episodes_of(question), float(score[before]), float(score[which])
        )


class Synthesis(Nearest):
    """The simulator that a query makes of the nearest ones; the best of these where it makes none."""

    synthesise: ClassVar[bool] = True

    def _versions(self, question: Question, choice: Choice) -> tuple[Version, ...]:
        nearest = super()._versions(question, choice)
        if choice.made is None or not np.isfinite(choice.replays.score[choice.made]):
            return nearest
        return (*nearest, self._version(question, choice, "synthesis", choice.made, 0, choice.best))

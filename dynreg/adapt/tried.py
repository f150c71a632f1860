"""The nouns of Back to Reality: the sizes of its steps, gaits on the robot, and simulators on the way."""

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NoReturn

import numpy as np

from dynreg.adapt.differences import DIFFERENCES
from dynreg.adapt.scores import Scores
from dynreg.errors import UsageError, one_of
from dynreg.search.table import SEARCHES

TRANSFER, REFINE = "transfer", "refine"  # what a trial is for: steps 2 and 4
ROULETTE = "roulette"  # the paper's search
START, BACK, ADAPTED = "start", "rolled back", "adapted"  # what made a version
ONES = ("iterations", "first", "later", "gaits", "stand", "repeats", "turns", "simulators", "near")
LEAST = MappingProxyType(dict.fromkeys(ONES, 1) | {"variations": 2, "steps": 0})


@dataclass(frozen=True)
class Rules:
    """The sizes of every step, as published but for `lost`, which is ours.

    iterations : at most. first, later : generations of step 1, in the first iteration and after it. gaits : candidates
    of one generation. search : one of `search.table.SEARCHES` for step 1. mutation : of the paper's, chance that a bit
    turns. near : simulators in which step 1 runs every gait, the adapted one and others beside it; the worst score
    counts. hope : simulated score with which step 1 ends early; None for never. stand : gaits that must stand on the
    robot (m). repeats : trials of each of them, and of the best of step 4, which counts by these alone. turns :
    generations of step 3, of so many `simulators`; it ends early where the difference is `enough` of its first value.
    difference : one of `differences.DIFFERENCES`. variations, steps : trials of one estimate of the gradient, and
    estimates. lost : where this share of gaits falls, the simulator before is used again. goal : score with which the
    task is met; None for never. Raises UsageError for sizes that make no sense.
    """

    iterations: int = 2
    first: int = 600
    later: int = 100
    gaits: int = 15
    search: str = ROULETTE
    mutation: float = 0.005
    near: int = 1
    hope: float | None = None
    stand: int = 10
    repeats: int = 3
    turns: int = 45
    simulators: int = 20
    enough: float = 0.2
    difference: str = "absolute"
    variations: int = 13
    steps: int = 10
    lost: float = 0.5
    goal: float | None = None

    def __post_init__(self) -> None:
        for name, least in LEAST.items():
            try:
                size = operator.index(getattr(self, name))
            except TypeError:
                _refuse(f"{name} = {getattr(self, name)}", f"a whole number, {least} or more")
            if size < least:
                _refuse(f"{name} = {size}", f"{least} or more")
            # NumPy's are none of JSON, by which a run is kept
            object.__setattr__(self, name, size)
        for name in ("enough", "lost", "mutation"):
            if not 0 < getattr(self, name) < 1:
                _refuse(f"{name} = {getattr(self, name)}", "a share between 0 and 1")
        if self.difference not in DIFFERENCES:
            _refuse(f"difference = {self.difference!r}", one_of(DIFFERENCES))
        if self.search not in SEARCHES:
            _refuse(f"search = {self.search!r}", one_of(SEARCHES))
        try:
            SEARCHES[self.search].require(self.gaits)
        except UsageError as error:
            _refuse(f"search = {self.search!r} with gaits = {self.gaits}: {error.problem}", error.expected)
        for name in ("goal", "hope"):
            score = getattr(self, name)
            if score is not None and not math.isfinite(score):
                _refuse(f"{name} = {score}", "a score, or None for none")

    def within(self, rollouts: int | None) -> "Rules":
        """Steps 1 and 3 with the same share of their generations, so that no more than `rollouts` are run.

        Raises UsageError where not even one generation of each is.
        """
        if rollouts is None or rollouts >= self.rollouts:
            return self
        one = replace(self, first=1, later=1, turns=1)
        if rollouts < one.rollouts:
            raise UsageError(
                f"a budget of {rollouts} simulations",
                expected=f"at least {one.rollouts}: one generation of each step",
                do="raise --budget",
            )
        share = (rollouts - one.rollouts) / (self.rollouts - one.rollouts)
        some = lambda generations: 1 + int(share * (generations - 1))  # noqa: E731
        return replace(self, first=some(self.first), later=some(self.later), turns=some(self.turns))

    @property
    def rollouts(self) -> int:
        """Runs of single gaits in single simulators, where every generation of every step is run."""
        gaits = self.near * self.gaits * (self.first + (self.iterations - 1) * self.later)
        # a search begins with the simulator before, which is graded before it, too
        simulators = self.iterations * (2 + self.turns * self.simulators)
        return gaits + simulators * self.stand


def _refuse(problem: str, expected: str) -> NoReturn:
    raise UsageError(problem, expected=expected, do="correct it")


@dataclass(frozen=True, eq=False)
class Tried(Scores):
    """A gait (G,) on the robot: its trials by number from 1, and their scores, None for the fall that ended them.

    iteration : from 1. step : `TRANSFER` or `REFINE`. simulated : its fitness in the simulator that it comes from;
    None where it was not run there.
    """

    gait: np.ndarray
    iteration: int
    step: str
    trials: tuple[int, ...]
    scores: tuple[float | None, ...]
    simulated: float | None = None


def best_of(tried: Iterable[Tried], repeats: int) -> Tried | None:
    """The gait with the highest score of those that stood in `repeats` trials; the first of equals.

    Only where there is none, one with fewer trials: of many gaits with one trial each, the best was lucky.
    """
    stood = [one for one in tried if not one.fell]
    return max(stood, key=lambda one: (len(one.trials) >= repeats, one.score), default=None)


@dataclass(frozen=True, eq=False)
class Adapted:
    """A simulator (P,) on the way. iteration : 0 of the first. made : `START`, `BACK` or `ADAPTED`.

    parent : number of the version that it came from. trials : those that shaped it. before, after : the difference at
    its parent and at it; None where nothing was adapted.
    """

    simulator: np.ndarray
    iteration: int
    made: str
    parent: int | None = None
    trials: tuple[int, ...] = ()
    before: float | None = None
    after: float | None = None


@dataclass(frozen=True, eq=False)
class Reached:
    """What it came to: versions, of which the last is the answer, and all gaits on the robot.

    ended : "goal", "iterations", or which budget of the robot is spent: see `BudgetError`.
    best : see `best_of`; None where all fell. resumed : simulations of steps 1 and
    3 that an interrupted run had left.
    """

    versions: tuple[Adapted, ...]
    tried: tuple[Tried, ...]
    best: Tried | None
    ended: str
    resumed: int

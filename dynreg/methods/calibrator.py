"""What every method is asked, and by what it may answer."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dynreg.methods.answer import Answer
from dynreg.progress import Progress
from dynreg.replay.data import Data
from dynreg.search.journal import Journal

if TYPE_CHECKING:
    from dynreg.adapt.plan import StageTable
    from dynreg.diagnose.threshold import Cache
    from dynreg.distance.population import Population
    from dynreg.methods.scored import Trying


ROUNDED = 1e-9  # of a range: more than any rounding, and less than any search moves


@dataclass(frozen=True, eq=False)
class Question:
    """A robot's recording, cut and parted, and where to begin.

    data : None for a method that tries the robot instead; see `Evidence.trying`. start : (P,) parameters in their
    units; by default those that the recording tells, else nominal. hold_out : what was asked for as the test part, of
    which no method sees the data.
    """

    data: Data | None
    start: np.ndarray | None = None
    hold_out: str | None = None

    @property
    def begin(self) -> np.ndarray:
        """(P,) in the unit cube, with what the recording tells in its place."""
        space = self.data.robot.space
        start = space.to_unit(self.data.start if self.start is None else self.start)
        return self.data.with_known(np.clip(start, 0.0, 1.0))

    @property
    def free(self) -> np.ndarray:
        """(P,) which parameters the recording does not tell."""
        return np.isnan(self.data.known)

    @property
    def fitted(self) -> np.ndarray:
        """(P,) which parameters something has fitted before: those that do not begin at their nominal value."""
        space = self.data.robot.space
        if self.start is None:
            return np.zeros(len(space), dtype=bool)
        # a value that went through the unit cube and back is rounded
        return ~np.isclose(space.to_unit(self.start), space.to_unit(space.nominal), rtol=0.0, atol=ROUNDED)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a method may use beside the recording; what it needs is there, else None.

    population : simulators of the same robot. plan : the stages of a staged calibration. cache : of what can be
    computed again. trying : the robot itself, its task, and gaits to begin with.
    """

    population: "Population | None" = None
    plan: "tuple[StageTable, ...] | None" = None
    cache: "Cache | None" = None
    trying: "Trying | None" = None


@dataclass(frozen=True, eq=False)
class Limits:
    """What a method may spend, and how it runs.

    simulations : simulators at most, each through all windows that are not held out, beside those by which registered
    ones are ranked; None for the method's own number.
    seed : of all draws. threads : 0 for all cores. journal : of a search, by its name, so that it can go on.
    """

    simulations: int | None = None
    seed: int = 0
    threads: int = 0
    journal: Callable[[str], Journal | None] = lambda _: None
    progress: Progress | None = None


class Calibrator(Protocol):
    """One method; its line in `methods.table` says what it reads. It draws from the seed alone and keeps nothing."""

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """The simulators that it makes of the question, the last of which is its answer."""


def episodes_of(question: Question) -> tuple[str, ...]:
    """Names of the episodes that are not held out."""
    data = question.data
    shaped = {int(data.windows.episode[w]) for w in data.parts.chosen}
    return tuple(data.recording.episodes[i].name for i in sorted(shaped))


def seconds_of(question: Question) -> float:
    """Simulated seconds of one simulator through all windows that are not held out."""
    windows = question.data.windows
    return float(len(question.data.parts.chosen) * (windows.measured.shape[1] - 1) * windows.period)

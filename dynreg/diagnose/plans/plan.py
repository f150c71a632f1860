"""What every plan does: calibrate, one round of naming, and the last fit."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynreg.diagnose.score import Naming
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term

# What is simulated: iterations of a calibration, steps that each tries beside derivatives, simulators for each term,
# and iterations of what is fitted to the end.
CALIBRATED, STEPS, PROBED, REFITTED = 12, 7, 4, 4


@dataclass(frozen=True, eq=False)
class State:
    """Where a search for causes stands.

    base : the calibrated simulator. current : that with the causes accepted so far. model, sample : with what was
    corrected on the way; the windows to fit, with the zeros of their episodes, and the independent samples of the
    calibrated simulator's residual. rounds : of naming; accepted : how many of them found a cause.
    """

    model: Model
    sample: Sample
    base: Point
    current: Point
    rounds: tuple[Naming, ...] = ()
    accepted: int = 0

    @property
    def data(self) -> Data:
        """The recording, its zeros moved to where the causes so far explain it best."""
        return self.sample.data

    @property
    def pooled(self) -> Sample:
        """The windows to fit and to select by together; the latter count as the former do on the average."""
        data, own = self.data, self.sample.effective
        more = np.tile(own.mean(axis=0), (len(data.select) * data.segments, 1))
        return Sample(data, data.both, np.concatenate([own, more]))

    def on(self, data: Data) -> "State":
        """The same search, held against other windows."""
        return replace(self, sample=replace(self.sample, data=data))


@dataclass(frozen=True)
class Plan(ABC):
    """How a diagnosis is searched for.

    draws : starts of the calibration besides the nameplate. hopeless : nats behind the best, from which a hypothesis is
    not fitted to the end. On bench_constants half and twice of each name the same.
    alike : whether logs of one cause look alike, so that simulators that carry it tell it from others.
    """

    alike: ClassVar[bool] = True
    draws: int = 0
    hopeless: float = 60.0

    @property
    def fitted(self) -> int:
        """How many points are fitted to the end; of many terms it does not count."""
        return 0

    def expected(self, parameters: int, terms: int, runs: int) -> int:
        """About how many simulators a search asks for that is run once on the log and `runs` times for its threshold.

        A search of one round took 1833 with 7 parameters and 31 terms (`Short`), 654 with 6 and 111 (`Long`); on the
        log itself, with a last fit and intervals, about twice as many. It is good to a factor of two.
        """
        calibration = CALIBRATED * (1 + self.draws / 2) * (parameters + STEPS)
        return round(
            (runs + 2) * (calibration + PROBED * terms + REFITTED * self.fitted * (parameters + STEPS))
        )

    @abstractmethod
    def name(
        self,
        model: Model,
        base: Point,
        terms: Sequence[Term],
        sample: Sample,
        hints: Sequence[Point] = (),
    ) -> Search[tuple[Naming, Model]]:
        """One round: the term that, added to `base`, explains most of what `base` leaves; and the corrected model.

        hints : `base` with terms and sizes that are likely, the likeliest term first: these are refitted in any case.
        """

    @abstractmethod
    def settle(self, state: State, posed: Data, seed: int) -> Search[State]:
        """The calibrated and the extended simulator on fit and select together.

        posed : the recording before its zeros were moved: the calibrated one is held against it.
        """


def stripped(base: Point, rivals: Sequence[Point]) -> list[Point]:
    """The model without its last term where these rivals ended: it gets the same chance."""
    return [Point(base.hypothesis, p.nominal, p.effect[: len(base.effect)]) for p in rivals]

"""What an answer fitted to several recordings says: its value in each, whether one serves all, and what is left."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.interval import Posterior
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point


@dataclass(frozen=True, eq=False)
class Fitted:
    """An answer fitted to one recording alone, with draws of its posterior.

    frame : coordinates of the parameters about the answer, which are the same for all recordings. left : root mean
    square of the residual, in the spreads of the motion, and the stated noise in the same unit.
    """

    model: Model
    point: Point
    draws: Posterior
    frame: Coordinates
    left: float
    noise: float

    @property
    def begin(self) -> np.ndarray:
        """(D,) where the fit's own coordinates begin in the frame."""
        return np.concatenate([self._within[0], np.zeros(len(self.point.effect))])

    @property
    def step(self) -> np.ndarray:
        """(D,) what one of the fit's own coordinates is in the frame."""
        return np.concatenate([self._within[1], np.ones(len(self.point.effect))])

    @cached_property
    def _within(self) -> tuple[np.ndarray, np.ndarray]:
        return self.model.coordinates.within(self.frame)


@dataclass(frozen=True)
class Value:
    """A number with its 90 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Refit:
    """One parameter of a simulator, or one size of a cause in it (its key), fitted to several recordings by name.

    values : that of each. same : one value fits all of them, which is `together` then. nats : of evidence that they
    differ. there : names of the recordings in which the cause is surely worth naming; absent : in which it may be not.
    """

    cause: str | None
    parameter: str
    unit: str
    values: Mapping[str, Value]
    together: Value
    same: bool
    nats: float
    there: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()

    @property
    def only(self) -> tuple[str, ...]:
        """Recordings that alone have the cause; () for what is the same, and for parameters."""
        return self.there if not self.same and len(self.there) + len(self.absent) == len(self.values) else ()


@dataclass(frozen=True)
class Left:
    """What the fit to one recording leaves, and the sensors' noise: both in spreads of the recording's motion."""

    residual: float
    noise: float


@dataclass(frozen=True)
class Refits:
    """Sizes of causes, then parameters; and by recording what its own fit leaves."""

    each: tuple[Refit, ...]
    left: Mapping[str, Left]


def difference(refit: Refit, before: str, after: str) -> Value:
    """By how much a value grew between two recordings; its interval takes them for independent."""
    a, b = refit.values[before], refit.values[after]
    return Value(
        b.value - a.value,
        b.value - a.value - float(np.hypot(b.value - b.low, a.high - a.value)),
        b.value - a.value + float(np.hypot(b.high - b.value, a.value - a.low)),
    )

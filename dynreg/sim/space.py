"""Parameters of a robot's simulators, their ranges and how they are sampled."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.errors import UsageError, one_of
from dynreg.rng import stream_seed

EDGE = 0.005  # of a range: what lies nearer to its end lies on it


def none_below(value: float, low: float, high: float) -> bool:
    """Whether a value at an edge of its range is at 0, as a friction may be: no wider range goes below it.

    >>> none_below(0.0, 0.0, 1.0), none_below(1.0, 0.0, 1.0), none_below(0.4, 0.4, 2.5)
    (True, False, False)
    """
    return low == 0.0 and value - low < high - value


@dataclass(frozen=True)
class Parameter:
    """One number that a simulator can differ in.

    nominal, low, high in `unit`; `scale` "linear" or "log"; `tolerance` is the nameplate's 1 sigma, relative
    to the nominal value (of the unit range where nominal is 0), inf where nothing is known; `known` where the
    lab knows it of its robot (the command rate); `sets` as in robot.toml.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    scale: str
    tolerance: float
    sets: tuple[str, ...]
    known: bool = False


@dataclass(frozen=True)
class ParameterSpace:
    """Parameters in the order of the value vector (P,)."""

    parameters: tuple[Parameter, ...]

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def nominal(self) -> np.ndarray:
        """(P,) nominal values."""
        return np.array([p.nominal for p in self.parameters])

    @property
    def bounds(self) -> np.ndarray:
        """(P, 2) low and high."""
        return np.array([[p.low, p.high] for p in self.parameters])

    def to_unit(self, values: np.ndarray) -> np.ndarray:
        """(..., P) values to [0, 1], through the logarithm where the scale is "log"."""
        low, high = self._stretched(self.bounds.T)
        return (self._stretched(np.asarray(values, dtype=float)) - low) / (high - low)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """(..., P) of [0, 1] to values; the inverse of `to_unit`, clipped to the bounds."""
        low, high = self._stretched(self.bounds.T)
        stretched = low + np.clip(unit, 0.0, 1.0) * (high - low)
        values = np.where(self._log, np.exp(np.where(self._log, stretched, 0.0)), stretched)
        return np.clip(values, *self.bounds.T)

    def at_bound(self, unit: np.ndarray) -> np.ndarray:
        """(..., P) whether parameters in [0, 1] lie on an edge of their range."""
        unit = np.asarray(unit)
        return (unit < EDGE) | (unit > 1.0 - EDGE)

    def sample(self, start: int, stop: int, seed: int) -> np.ndarray:
        """(stop - start, P) rows of one scrambled Sobol sequence: row i never depends on how many are drawn."""
        from scipy.stats import qmc

        sobol = qmc.Sobol(len(self), scramble=True, rng=np.random.default_rng(stream_seed(seed, "sobol")))
        if start:
            sobol.fast_forward(start)
        with warnings.catch_warnings():
            # balance needs a power of two; ranges need not be one
            warnings.simplefilter("ignore", UserWarning)
            return self.from_unit(sobol.random(stop - start))

    def with_ranges(self, ranges: dict[str, tuple[float, float]]) -> "ParameterSpace":
        """The same parameters with other bounds; nominal values are moved inside them."""
        self._check_known(ranges)
        changed = []
        for p in self.parameters:
            low, high = ranges.get(p.name, (p.low, p.high))
            if not low < high or (p.scale == "log" and low <= 0):
                raise UsageError(
                    f"range {low}..{high} of {p.name!r}",
                    expected="low < high" + (" and low > 0 (log scale)" if p.scale == "log" else ""),
                    do="correct the range",
                )
            changed.append(replace(p, low=low, high=high, nominal=float(np.clip(p.nominal, low, high))))
        return ParameterSpace(tuple(changed))

    def as_dict(self, values: np.ndarray) -> dict[str, float]:
        """{name: value} of one vector (P,)."""
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}

    def from_dict(self, values: dict[str, float]) -> np.ndarray:
        """(P,) from {name: value}; parameters not named take their nominal value."""
        self._check_known(values)
        return np.array([float(values.get(p.name, p.nominal)) for p in self.parameters])

    def _check_known(self, names: Iterable[str]) -> None:
        unknown = sorted(set(names) - set(self.names))
        if unknown:
            raise UsageError(
                f"unknown parameter {unknown[0]!r}",
                expected=one_of(self.names, unknown[0]),
                do="correct the name",
            )

    @property
    def _log(self) -> np.ndarray:
        return np.array([p.scale == "log" for p in self.parameters])

    def _stretched(self, values: np.ndarray) -> np.ndarray:
        return np.where(self._log, np.log(np.where(self._log, values, 1.0)), values)

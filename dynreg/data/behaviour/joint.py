"""A joint as logs show it: its position, and beside it velocity, target and effort, run by run."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.episodes import RawEpisode
from dynreg.data.names import joint_of, quantity_of
from dynreg.data.outliers import spikes
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Series
from dynreg.data.words import quantity, words

LEAST = 100  # rows of a run below which nothing can be said of it
_EFFORTS = ("torque", "current", "duty", "voltage")


@dataclass(frozen=True, eq=False)
class Run:
    """One joint in one run, on the stamps of its position.

    time, position : (T,) [s], [rad or m]. velocity, target, effort, asked : (T,), None where they are not logged. asked
    is a commanded effort.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None = None
    target: np.ndarray | None = None
    effort: np.ndarray | None = None
    asked: np.ndarray | None = None

    @property
    def step(self) -> float:
        """The usual time between two rows [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def rate(self) -> np.ndarray:
        """(T,) the rate of the position, by differences over two steps."""
        return np.gradient(self.position, self.time)


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint in all runs of a log.

    effort, effort_unit : name and unit of what its drive gave, "" where that is not logged. asked, asked_unit : of what
    it was told to give; limits : of that, in its unit, None where they are not known. led : whether it was told where
    to be, or how fast.
    """

    name: str
    unit: str
    runs: tuple[Run, ...]
    effort: str = ""
    effort_unit: str = ""
    asked: str = ""
    asked_unit: str = ""
    limits: tuple[float, float] | None = None
    led: bool = False

    def pooled(self, of: Callable[[Run], np.ndarray | None]) -> np.ndarray:
        """(N,) a signal of all runs, one after the other; empty where a run lacks it."""
        found = [of(run) for run in self.runs]
        return np.concatenate(found) if found and all(one is not None for one in found) else np.empty(0)

    @property
    def reach(self) -> float:
        """How far the position goes in all runs."""
        return float(np.ptp(self.pooled(lambda run: run.position)))


@dataclass(frozen=True)
class Seen:
    """What a check saw of one joint.

    kind : what alike joints are told of together. numbers : those that the message names, in its order. other : another
    joint that it names.
    """

    check: str
    kind: str
    numbers: tuple[float, ...]
    units: tuple[str, ...] = ()
    other: str = ""


def grain(values: np.ndarray) -> float:
    """The step of a sensor: the usual distance between neighbouring values that it gives; 0 where it gives one.

    Distances below a millionth of the range come of rounding.
    """
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > 1e-6 * np.ptp(values)] if len(gaps) else gaps
    return float(np.median(gaps)) if len(gaps) else 0.0


def joints_of(episodes: Iterable[RawEpisode], spec: RecordingSpec) -> tuple[Joint, ...]:
    """The joints of which positions are logged, with their runs that are long enough."""
    every = list(episodes)
    named = dict.fromkeys(joint_of(c.name) for c in spec.channels if quantity_of(c.name) == "position")
    found = (_joint(name, every, [c for c in spec.channels if joint_of(c.name) == name]) for name in named)
    return tuple(joint for joint in found if joint.runs)


def _joint(name: str, episodes: Sequence[RawEpisode], channels: Sequence[ChannelSpec]) -> Joint:
    position = next(c for c in channels if quantity_of(c.name) == "position")
    velocity = _first(channels, lambda c: quantity_of(c.name) == "velocity" and c.kind == "state")
    target = _first(channels, lambda c: c.kind == "action" and c.unit == position.unit)
    effort = _first(channels, lambda c: c.kind != "action" and _is_effort(c))
    asked = _first(channels, lambda c: c.kind == "action" and _is_effort(c))
    runs = (_run(e, position, (velocity, target, effort, asked)) for e in episodes)
    limits = None if asked is None or asked.low is None or asked.high is None else (asked.low, asked.high)
    return Joint(
        name,
        position.unit,
        tuple(run for run in runs if run is not None),
        *_named(effort),
        *_named(asked),
        limits=limits,
        led=any(c.kind == "action" and not _is_effort(c) for c in channels),
    )


def _named(channel: ChannelSpec | None) -> tuple[str, str]:
    return ("", "") if channel is None else (quantity_of(channel.name), channel.unit)


def _is_effort(channel: ChannelSpec) -> bool:
    return quantity(words(quantity_of(channel.name))) in _EFFORTS or channel.unit in ("N*m", "N", "A")


def _first(channels: Sequence[ChannelSpec], fits: Callable[[ChannelSpec], bool]) -> ChannelSpec | None:
    return next((c for c in channels if fits(c)), None)


def _run(episode: RawEpisode, position: ChannelSpec, others: Sequence[ChannelSpec | None]) -> Run | None:
    """The run of a joint; None where its position is not logged, or hardly, or its clock does not run on."""
    own = _known(episode.channels.get(position.name), spikes)
    if own is None:
        return None
    signals = [None if c is None else _at(_known(episode.channels.get(c.name)), own, c.hold) for c in others]
    return Run(own.time, own.values, *signals)


def _known(series: Series | None, without: Callable[[np.ndarray], np.ndarray] | None = None) -> Series | None:
    """Its rows with numbers, and not `without`; None where these are few, or their stamps do not increase."""
    if series is None:
        return None
    keep = np.isfinite(series.values) & np.isfinite(series.time)
    if without is not None:
        keep[without(series.values)] = False
    series = series.rows(keep)
    return series if len(series) >= LEAST and (np.diff(series.time) > 0).all() else None


def _at(series: Series | None, own: Series, hold: bool) -> np.ndarray | None:
    """(T,) a signal on the stamps of another: held or interpolated."""
    if series is None or np.array_equal(series.time, own.time):
        return None if series is None else series.values
    if not hold:
        return np.interp(own.time, series.time, series.values)
    return series.values[np.maximum(np.searchsorted(series.time, own.time + 1e-9, "right") - 1, 0)]

"""What a log tells of a robot: which channels it holds, how often, how noisy, and what its commands are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dynreg.data.checks import check_clocks, errors
from dynreg.data.checks.clock import FASTEST, doubted, likely_units, quickest, whole_step
from dynreg.data.drafting import Draft
from dynreg.data.episodes import raw_episodes
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog, Series
from dynreg.draft.tables import Sensed
from dynreg.errors import LogError
from dynreg.sim.stops import with_stops

Named = tuple[str, str]  # a channel or an action, and its unit
QUIET = 0.25  # share of a log in which a signal moves least: its noise is that of these moments
BLOCK = 20  # samples of one moment
# Orders of the differences that take motion out of a signal, also out of that of a joint that is never still.
ORDERS = (3, 4, 5, 6, 7, 8)
# Of white noise, the size of differences of these orders in its quietest moments (of 500,000 samples).
WHITE = {3: 0.717, 4: 0.700, 5: 0.685, 6: 0.673, 7: 0.661, 8: 0.651}
FLAT = 0.8  # share to which the next order falls where noise is left alone: less, and it is motion still
# Noise that is never undercut, by unit: numbers are rounded.
LEAST = {"rad": 1e-5, "m": 1e-6, "rad/s": 1e-4, "m/s": 1e-5}
STILL = 2.0  # times its noise that a signal varies, 1 sigma, below which its motion cannot be told from noise
WHOLE = 0.02  # share of a quantum by which steps may miss a whole number of it
FOLLOWS = 0.8  # correlation from which a command is one for the position
MOST_CONTROL = 500.0  # Hz: a faster log is thinned by whole numbers
RARE = 5.0  # Hz: commands that come less often are held, and the robot's rate is that of its measurements


@dataclass(frozen=True)
class Heard:
    """What a log tells. series : of the channels and actions that it holds, in their units, of its longest episode, the
    rows that have a number: a row of a table that joins several clocks has one of each signal's, or none.

    clock : how often the rows of a table come [Hz], whatever its columns are; None where that is not known.
    """

    series: Mapping[str, Series]
    clock: float | None = None

    def first(self, name: str) -> float | None:
        """The first value of a channel; None where the log lacks it."""
        values = self.series[name].values if name in self.series else np.zeros(0)
        known = values[np.isfinite(values)]
        return float(known[0]) if len(known) else None

    def largest(self, name: str) -> float:
        """The largest size of a channel; 0 where the log lacks it."""
        return float(np.nanmax(np.abs(self.series[name].values), initial=0.0)) if name in self.series else 0.0

    def rate(self, actions: Sequence[str]) -> float | None:
        """How often the robot is controlled [Hz]: as `often`, at most `MOST_CONTROL`; None where no stamps tell."""
        often = self.often(actions)
        return None if often is None else rounded_rate(often / thinned(often))

    def often(self, actions: Sequence[str]) -> float | None:
        """How often commands come [Hz], by their stamps; None where no stamps tell.

        How often measurements come, where these are more frequent than commands that are `RARE` or missing; how often
        rows come, where neither is known.
        """
        told = _often([s for name, s in self.series.items() if name in actions])
        if told is None or told < RARE:
            measured = _often([s for name, s in self.series.items() if name not in actions])
            told = max((rate for rate in (told, measured) if rate is not None), default=self.clock)
        return told

    def follows(self, command: str, position: str) -> bool:
        """Whether a command is where the position goes."""
        at, went = self._together(command, position)
        if len(at) < BLOCK or np.std(at) == 0 or np.std(went) == 0:
            return False
        close = np.sqrt(np.mean((at - went) ** 2)) < 2.0 * np.std(went)
        return bool(close and np.corrcoef(at, went)[0, 1] > FOLLOWS)

    def missed(self, command: str, measured: str) -> float | None:
        """By how much a joint misses its command [rms, in its unit]; None where the log does not tell both."""
        at, went = self._together(command, measured)
        return float(np.sqrt(np.mean((at - went) ** 2))) if len(at) >= BLOCK else None

    def _together(self, command: str, measured: str) -> tuple[np.ndarray, np.ndarray]:
        """(N,) values of both at the stamps of the second at which both are known; none where the log lacks one."""
        if command not in self.series or measured not in self.series:
            return np.zeros(0), np.zeros(0)
        told, went = self.series[command], self.series[measured]
        at = np.interp(went.time, told.time, told.values)
        known = np.isfinite(at) & np.isfinite(went.values)
        return at[known], went.values[known]


def thinned(often: float) -> int:
    """Of how many commands that come so `often` [Hz] control takes one, so that it is no faster than `MOST_CONTROL`."""
    return int(max(1.0, np.ceil(often / MOST_CONTROL - 1e-3)))


def rounded_rate(rate: float) -> float:
    """A rate [Hz] without the scatter of the stamps that it is of.

    >>> rounded_rate(99.6), rounded_rate(0.66666)
    (100.0, 0.6667)
    """
    whole = abs(rate - round(rate)) < 0.01 * rate and rate > 2
    return float(round(rate)) if whole else float(f"{rate:.4g}")


def _often(signals: Sequence[Series]) -> float | None:
    """How often signals come [Hz], by their stamps; None where these tell nothing."""
    steps = [np.median(np.diff(s.time)) for s in signals if len(s) > 2]
    steps = [step for step in steps if step > 0]
    return 1.0 / float(np.median(steps)) if steps else None


def _clock_of(log: RawLog) -> float | None:
    """How often the rows of a table come [Hz]; None for messages, and for a clock that seems not to count seconds."""
    if log.counting is None or log.counting.told == "steps":
        return None
    sure = (s for s in log.sources.values() if len(s) > 2 and doubted(s.time, log.counting) is None)
    column = next(sure, None)
    return None if column is None else _often([column])


def spec_of(model: mujoco.MjModel, channels: Sequence[Named], actions: Sequence[Named]) -> RecordingSpec:
    """What a recording of the model with these channels and actions holds, where its log has it."""
    every = [
        (*named, kind) for kind, listed in (("state", channels), ("action", actions)) for named in listed
    ]
    specs = [ChannelSpec(name, unit, kind, optional=True) for name, unit, kind in every]
    return with_stops(model, RecordingSpec("drafted", tuple(specs), (), None))


def heard(draft: Draft) -> Heard:
    """What a log tells of the channels and actions of its drafted map."""
    clock = _clock_of(draft.log)
    if not draft.sources:
        return Heard({}, clock)
    episodes = raw_episodes(draft.log, draft.log_map, draft.spec)
    known = [{name: s.rows(np.isfinite(s.values)) for name, s in e.channels.items()} for e in episodes]
    longest = max(known, key=lambda channels: max(map(len, channels.values()), default=0))
    return Heard({name: s for name, s in longest.items() if len(s)}, clock)


def require_clocks(told: Heard, log: RawLog) -> None:
    """LogError where what was heard of a log has a clock that tells no rate: it runs back, stands still, or counts in
    another unit than is known.
    """
    for found in errors(check_clocks(told.series, log.path.name, None)):
        do = found.do
        if not do or "[episodes]" in do:  # no map is read here
            do = "mend it, or split the log there"
        raise LogError(
            f"{found.where}: {found.message}",
            expected="a clock that runs on",
            do=f"{do}, or draft without --log: `dynreg doctor LOG --robot FOLDER --draft-map MAP` then writes a map",
        )
    counting = log.counting
    if not told.series or counting is None:
        return
    time = quickest(log)
    if likely_units(log) == ("ms", "s") and (step := whole_step(time)):
        raise LogError(
            f"{log.path.name}: stamps in column {counting.column!r} go up by {step}: seconds ({1 / step:g} Hz) or "
            f"milliseconds ({1000 / step:g} Hz)",
            expected="a name of the column that tells the unit",
            do="call the column time_ms, or time_s; if it counts rows, replace it by seconds",
        )
    doubt = doubted(time, counting)
    if doubt is not None:
        known = "" if counting.told else f"seconds in column {counting.column!r}, or "
        if not doubt.rates:
            mapped = "[map]" in doubt.do  # no map is read here
            do = (
                f"write seconds in a column time_s, at most {FASTEST:g} rows a second" if mapped else doubt.do
            )
        else:
            do = f"call the column {' or '.join(f'time_{unit}' for unit in doubt.rates)}"
            do += ", or write it in the unit that its name says" * bool(counting.told)
        raise LogError(f"{log.path.name}: {doubt.said}", expected=f"{known}a name that tells the unit", do=do)


def sensed(series: Series, unit: str) -> Sensed | None:
    """Noise and quantum of a channel by the moments at which it moves least; None for too few samples.

    Of a rate that was computed it is the error of that: where it moves least, a filter leaves no noise to be seen.
    """
    values = series.values[np.isfinite(series.values)]
    if len(values) < 3 * BLOCK:
        return None
    if series.error is not None:
        noise = max(np.nan_to_num(series.error), LEAST.get(unit, 1e-6))
        return Sensed(
            float(f"{noise:.2g}"), 0.0, "by the noise of positions and what the filter takes away", False
        )
    quantum = _quantum(values)
    sizes = [_unsteady(values, order) for order in ORDERS]
    flat = (a for a, b in zip(sizes, sizes[1:], strict=False) if b > FLAT * a)  # motion falls, noise stays
    noise = next(flat, sizes[-1])
    noise = float(np.sqrt(max(noise**2 - quantum**2 / 12, 0.0)))
    if quantum == 0 or noise > quantum:
        noise = max(noise, LEAST.get(unit, 1e-6))
    still = bool(np.std(values) < STILL * max(noise, quantum))
    said = "in which it does not move" if still else "by differences, where it moves least"
    return Sensed(float(f"{noise:.2g}"), float(f"{quantum:.4g}"), f"of the log, {said}", still)


def _unsteady(values: np.ndarray, order: int) -> float:
    """1 sigma of what no polynomial explains, by differences of an order, where a signal moves least."""
    differences = np.diff(values, order) / np.sqrt(float(math.comb(2 * order, order)))
    blocks = differences[: len(differences) // BLOCK * BLOCK].reshape(-1, BLOCK)
    sizes = np.sort(np.sqrt((blocks**2).mean(axis=1)))
    quiet = np.median(sizes[: max(1, round(QUIET * len(sizes)))])
    # where all is noise, the quietest moments are so by chance: their noise is that of all of them
    return float(min(np.median(sizes), quiet / WHITE[order]))


def _quantum(values: np.ndarray) -> float:
    """The step that all differences are whole numbers of; 0 where there is none."""
    steps = np.abs(np.diff(values))
    largest = float(np.abs(values).max(initial=0.0))
    steps = steps[steps > 1e-9 * max(largest, 1e-9)]
    if len(steps) < BLOCK or len(np.unique(np.round(values, 12))) > len(values) / 2:
        return 0.0
    least = float(np.percentile(steps, 1))
    near = steps[steps < 20 * least] / least
    return least if len(near) and (np.abs(near - np.round(near)) < WHOLE).mean() > 0.95 else 0.0

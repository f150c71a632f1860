"""Stamps that run back, stand still, repeat, scatter, fall silent or count in another unit."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.checks.runs import longest_run
from dynreg.data.clock_names import UNITS_OF_TIME
from dynreg.data.series import SECONDS, Counting, Finding, RawLog, Series

STANDSTILL_ROWS = 10  # rows with one and the same stamp that make a stopped clock
SHARED = 0.1  # share of the rows with the stamp of the row before, from which on stamps are coarse
ALIKE = 3.0  # times the usual number of rows with one stamp that a coarse clock may stay at one
WHOLE = 0.01  # of the step of a coarse clock, by which its steps may miss a whole number of that
NEAR = 5.0  # usual steps, by which rows that changed places lie apart at most
STAMPS = "mend it, or write the stamps with more digits"
JITTER = 3.0  # 99th percentile over median period
SLOW_STEP = 2.0  # [s] between rows: a clock in another unit, where nothing tells that it counts seconds
NEVER = 200.0  # [s] between rows of no robot's log, whatever the name of the clock says
SLOWEST, FASTEST = 5.0, 20_000.0  # [Hz] of logs: a unit that makes one slower or faster is not the likely one
PARTS = 5_000.0  # [Hz] of a log whose steps are parts of the unit that its clock's name says
SINCE_1970 = (1e9, 1e10)  # [s] stamps that count from 1970: of the years 2001 to 2286. More are milliseconds
DAY = 86_400.0  # [s] that spreadsheets and MATLAB count by
LIKELY: Mapping[str, str] = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
}


@dataclass(frozen=True)
class Doubt:
    """That a clock counts in another unit than it was read in. said : why. rates : {unit: rows a second [Hz]} of those
    that are likelier; none where it is none that is read. do : what to do, where there is a map.
    """

    said: str
    rates: Mapping[str, float]
    do: str

    @property
    def unit(self) -> str | None:
        """The one likely unit; None where there are more, or none."""
        return next(iter(self.rates)) if len(self.rates) == 1 else None


@dataclass(frozen=True)
class Coarse:
    """That stamps are written with so few digits that many rows share one. said : how often; do : what to do."""

    said: str
    do: str


def check_clocks(
    channels: Mapping[str, Series],
    where: str,
    gap: float | None,
    only_gaps: bool = False,
    counting: Counting | None = SECONDS,
) -> Iterator[Finding]:
    """Clock findings, once for all signals that share their stamps."""
    groups: dict[bytes, list[str]] = {}
    for name, series in channels.items():
        groups.setdefault(series.time.tobytes(), []).append(name)
    for names in groups.values():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        time = channels[names[0]].time
        here = f"{where}, {names[0]}{more}"
        if not only_gaps:
            repeats = bool((np.diff(time) == 0).any())
            rounded = coarse([channels[name] for name in names]) if repeats else None
            yield from check_clock(time, here, counting, rounded)
        if gap is not None:
            yield from check_gaps(time, here, gap, counting)


def check_clock(
    time: np.ndarray, where: str, counting: Counting | None = SECONDS, rounded: Coarse | None = None
) -> Iterator[Finding]:
    """Stamps that run back, stand still, repeat or scatter, or whose clock counts in another unit than `counting`.

    rounded : what is said of them where they are `coarse`.
    """
    good = np.isfinite(time)
    if not good.all():
        row = int(np.argmin(good))
        text = f"{int((~good).sum())} rows have no time stamp: they are left out"
        yield Finding("warning" if good.any() else "error", "clock", f"{where}, row {row}", text)
        time = time[good]
    steps = np.diff(time)
    if not len(steps):
        return
    back = np.flatnonzero(steps < 0)
    if len(back):
        row = int(back[0]) + 1
        yield Finding(
            "error",
            "clock",
            f"{where}, row {row}",
            f"the clock runs back by {-steps[row - 1]:.6g} s at {time[row - 1]:.6f} s "
            f"({len(back)} time{'s' * (len(back) > 1)})",
            _to_mend(time),
        )
    equal = steps == 0
    if equal.any():
        start, run = longest_run(equal)
        stopped = run >= STANDSTILL_ROWS
        if rounded:
            text, do = rounded.said, rounded.do
        elif stopped:
            text, do = f"the clock stands still at {time[start]:.6f} s for {run + 1} rows", STAMPS
        else:
            text, do = f"{int(equal.sum())} stamps repeat the one before", ""
        text += "" if stopped else "; of rows with the same stamp the last one counts"
        yield Finding("error" if stopped else "warning", "clock", f"{where}, row {start}", text, do)
    moving, doubt = steps[steps > 0], doubted(time, counting)
    if doubt is not None:
        yield Finding("warning", "clock", where, doubt.said, doubt.do)
    elif len(moving) >= 10:
        median, late = np.median(moving), np.quantile(moving, 0.99)
        if late > JITTER * median:
            text = f"uneven stamps: median {1e3 * median:.3g} ms, 99 % below {1e3 * late:.3g} ms"
            yield Finding("info", "jitter", where, text)


def _to_mend(time: np.ndarray) -> str:
    """What to do with stamps (T,) that run back: rows in a wrong order are sorted, runs one after another are split."""
    steps = np.diff(time)
    sort, split = "sort the rows by their stamps", 'split there with by = "gaps" under [episodes]'
    if (steps <= 0).all():
        return f"the rows are in reverse order: {sort}"
    if -steps.min() < NEAR * np.median(np.abs(steps)):
        return f"if rows are out of order, {sort}; if the clock was set back, {split}"
    return f"mend it, or {split}"


def coarse(signals: Iterable[Series]) -> Coarse | None:
    """What is said of stamps that are `Coarse`; None of others.

    signals : of one clock or several, the first that tells. Rows that repeat another as a whole are none of these, nor
    are those of a clock that stops.
    """
    for signal in signals:
        if not (np.diff(signal.time) == 0).any():
            continue
        known = signal.rows(np.isfinite(signal.values) & np.isfinite(signal.time))
        steps = np.diff(known.time)
        equal, moving = steps == 0, steps[steps > 0]
        shared = int((equal & (np.diff(known.values) != 0)).sum())
        if len(moving) < 10 or (steps < 0).any() or shared < SHARED * len(steps):
            continue
        least, often = float(moving.min()), len(steps) / len(moving)
        missed = np.abs(moving / least - np.round(moving / least)).max()
        if longest_run(equal)[1] > ALIKE * often or missed > WHOLE:
            continue
        changed = np.flatnonzero(steps > 0) + 1
        rows = int(changed[-1] - changed[0])
        every = _shortest((known.time[changed[-1]] - known.time[changed[0]]) / rows, rows)
        return Coarse(
            f"{int(equal.sum())} of {len(known)} stamps repeat the one before: they are written to {least:.3g} s, and "
            f"rows come about every {every} s",
            f"write them with more digits or, if rows come evenly, as the number of the row times {every}",
        )
    return None


def _shortest(step: float, rows: int) -> str:
    """The fewest digits of a step that over so many rows miss less than one of them: no more is known.

    >>> _shortest(0.0105261, 2000), _shortest(0.007987, 297)
    ('0.01053', '0.008')
    """
    texts = (f"{step:.{digits}g}" for digits in range(1, 17))
    return next((text for text in texts if abs(float(text) - step) * rows < step), f"{step:g}")


def doubted(time: np.ndarray, counting: Counting | None) -> Doubt | None:
    """The doubt about a clock with stamps (T,) [s] that was read as `counting` tells; None where there is none.

    What a map or dates say is not doubted, nor are messages (None). What a name says is where no robot is logged so.
    """
    step = usual_step(time)
    if not step or counting is None or counting.told in ("map", "dates", "steps"):
        return None
    named, units = counting.told == "name", [*UNITS_OF_TIME]
    at, written = units.index(counting.unit), step / UNITS_OF_TIME[counting.unit]
    if step > (NEVER if named else SLOW_STEP):
        slowest = {} if counting.unit == "ns" else {"ns": 1.0 / (written * UNITS_OF_TIME["ns"])}
        rates = _rates(written, units[at + 1 :]) or slowest
    else:
        rates = _rates(written, units[:at])
        parts = named and written < 1.0 and bool(rates)  # who logs faster than his unit takes a finer one
        if 1.0 / step <= (PARTS if parts else FASTEST):
            return None
    told = [LIKELY[one] + f" ({rate:.0f} Hz)" * (len(rates) > 1 or named) for one, rate in rates.items()]
    looks = f"the clock looks like {' or '.join(told)}" if told else "no robot is logged so"
    would = f"the median step is {step:.4g} s" + f" ({1.0 / step:.0f} Hz)" * (step < 1.0)
    if named:
        would = f"the name {counting.column!r} says {LIKELY[counting.unit]}, but then {would}"
    set_as = " or ".join(map(json.dumps, rates or [counting.unit]))
    unless = (
        f', or "{counting.unit}" if the name is right' if named and rates else " if it is so" * (not rates)
    )
    do = f"set time_unit = {set_as} under [map]{unless}"
    if not told and 1.0 / FASTEST < DAY * written < 1.0 / SLOWEST:
        looks, do = "the clock looks like days", f"multiply it by {DAY:.0f} and call it time_s"
    return Doubt(f"{would}: {looks}", rates, do)


def _rates(step: float, units: Sequence[str]) -> dict[str, float]:
    """{unit: rows a second [Hz]} of a clock with steps of so many, in those units in which a robot may be logged so."""
    rates = {unit: 1.0 / (step * UNITS_OF_TIME[unit]) for unit in units}
    return {unit: rate for unit, rate in rates.items() if SLOWEST <= rate <= FASTEST}


def quickest(log: RawLog) -> np.ndarray:
    """The stamps (T,) [s] of a log's quickest clock, which tells the unit: slow signals may stand beside quick ones."""
    return min(_clocks(log), key=_step_known, default=np.zeros(0))


def _clocks(log: RawLog) -> list[np.ndarray]:
    """The stamps (T,) [s] of each clock of a log, once however many signals share it."""
    alike: dict[tuple[float, ...], list[np.ndarray]] = {}
    for time in (series.time for series in log.sources.values() if len(series) > 2):
        others = alike.setdefault((len(time), time[0], time[-1]), [])
        if not any(time is other or np.array_equal(time, other) for other in others):
            others.append(time)
    return [time for some in alike.values() for time in some]


def _step_known(time: np.ndarray) -> float:
    """The usual step [s] of a clock; infinite for too few stamps."""
    return usual_step(time) or np.inf


def likely_units(log: RawLog) -> tuple[str, ...]:
    """The units in which a table's clock may count, by what tells it and by its steps; none of messages."""
    counting, time = log.counting, quickest(log)
    if counting is None:
        return ()
    doubt = doubted(time, counting)
    if doubt is not None:
        return tuple(doubt.rates) or (counting.unit,)
    return (
        ("ms", "s") if not counting.told and whole_step(time) and not tells_seconds(log) else (counting.unit,)
    )


def tells_seconds(log: RawLog) -> bool:
    """Whether a log's first stamp tells that its clock counts seconds: a date, a time since 1970, or a fraction."""
    first, last = SINCE_1970
    return first <= log.start < last or log.start % 1.0 != 0.0


def whole_step(time: np.ndarray) -> int | None:
    """The usual step of stamps that are whole numbers, 1 or 2; None for others. Longer ones are `doubted`."""
    step, known = usual_step(time), time[np.isfinite(time)]
    whole = 1.0 <= step <= SLOW_STEP and bool((np.mod(np.append(known, step), 1.0) == 0.0).all())
    return int(step) if whole else None


def usual_step(time: np.ndarray) -> float:
    """The median step of a clock [s]; 0 for too few stamps."""
    steps = np.diff(time)
    moving = steps[steps > 0]
    return float(np.median(moving)) if len(moving) >= 10 else 0.0


def check_gaps(
    time: np.ndarray, where: str, gap: float, counting: Counting | None = SECONDS
) -> Iterator[Finding]:
    """Silences longer than `gap` [s]; where most steps are, these are no gaps: it is the rate, or another unit."""
    steps = np.diff(time)
    long = np.flatnonzero(steps > gap)
    if 2 * len(long) > len(steps):
        if doubted(time, counting) is None:
            asked = counting is not None and not counting.told
            unit = (
                'if the time column counts milliseconds, set time_unit = "ms" under [map]; if not, ' * asked
            )
            text = (
                f"{len(long)} of {len(steps)} rows come more than {gap:g} s after the one before, usually "
                f"{np.median(steps[long]):.4g} s"
            )
            yield Finding("warning", "gap", where, text, f"{unit}set `gap` above that under [episodes]")
    elif len(long):
        first = int(long[0])
        yield Finding(
            "warning",
            "gap",
            f"{where}, row {first + 1}",
            f"{len(long)} {'gap' if len(long) == 1 else 'gaps'} longer than {gap:g} s, the first "
            f"{steps[first]:.3f} s at {time[first]:.3f} s, the longest {steps.max():.3f} s",
            'split there with by = "gaps" under [episodes]',
        )

"""Stamps that run back, stand still, repeat, scatter, fall silent or count in another unit."""

import json
from collections.abc import Iterator, Mapping

import numpy as np

from dynreg.data.checks.runs import longest_run
from dynreg.data.series import Finding, Series
from dynreg.data.units import UNITS

STANDSTILL_ROWS = 10  # rows with one and the same stamp that make a stopped clock
JITTER = 3.0  # 99th percentile over median period
SLOW_STEP = 2.0  # [s] between rows: a clock in another unit
LIKELY: Mapping[str, str] = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
FASTEST = 20_000.0  # [Hz] logs of robots are slower: a unit that makes one faster is none of its clock


def check_clocks(
    channels: Mapping[str, Series], where: str, gap: float | None, only_gaps: bool = False
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
            yield from check_clock(time, here)
        if gap is not None:
            yield from check_gaps(time, here, gap)


def check_clock(time: np.ndarray, where: str) -> Iterator[Finding]:
    """Stamps that run back, stand still, repeat or scatter."""
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
            f"({len(back)} time{'s' * (len(back) > 1)}); "
            'mend it, or split there with by = "gaps" under [episodes]',
        )
    equal = steps == 0
    if equal.any():
        start, run = longest_run(equal)
        stopped = run >= STANDSTILL_ROWS
        yield Finding(
            "error" if stopped else "warning",
            "clock",
            f"{where}, row {start}",
            f"the clock stands still at {time[start]:.6f} s for {run + 1} rows"
            if stopped
            else f"{int(equal.sum())} stamps repeat the one before; of rows with the same stamp the last one counts",
        )
    moving, unit = steps[steps > 0], likely_unit(time)
    if unit is not None:
        units = " or ".join(map(json.dumps, _rates(time, unit)))
        text = f"{slow_clock(time, unit)}; set time_unit = {units} under [map]"
        yield Finding("warning", "clock", where, text)
    elif len(moving) >= 10:
        median, late = np.median(moving), np.quantile(moving, 0.99)
        if late > JITTER * median:
            text = f"uneven stamps: median {1e3 * median:.3g} ms, 99 % below {1e3 * late:.3g} ms"
            yield Finding("info", "jitter", where, text)


def likely_unit(time: np.ndarray) -> str | None:
    """The unit ("ms", "us" or "ns") of stamps (T,) whose steps are too long to be seconds; None for others."""
    step = usual_step(time)
    if step <= SLOW_STEP:
        return None
    return "ns" if step > 2e5 else "us" if step > 200 else "ms"


def whole_step(time: np.ndarray) -> int | None:
    """The usual step of stamps that are whole numbers, 1 or 2; None for others. Longer ones have a `likely_unit`."""
    step, known = usual_step(time), time[np.isfinite(time)]
    whole = 1.0 <= step <= SLOW_STEP and bool((np.mod(np.append(known, step), 1.0) == 0.0).all())
    return int(step) if whole else None


def slow_clock(time: np.ndarray, unit: str) -> str:
    """What is said of stamps (T,) that count in this `likely_unit`, or in a finer one that may be meant as well."""
    rates = _rates(time, unit)
    told = [LIKELY[one] + f" ({rate:.0f} Hz)" * (len(rates) > 1) for one, rate in rates.items()]
    return f"the median step is {usual_step(time):.4g} s: the clock looks like {' or '.join(told)}"


def _rates(time: np.ndarray, unit: str) -> dict[str, float]:
    """{unit: rows a second [Hz]} of a clock that counts in this `likely_unit`, or in a finer one."""
    step, units = usual_step(time), list(LIKELY)
    rates = {one: 1.0 / (step * UNITS[one][1]) for one in units[units.index(unit) :]}
    return {one: rate for one, rate in rates.items() if one == unit or rate <= FASTEST}


def usual_step(time: np.ndarray) -> float:
    """The median step of a clock [s]; 0 for too few stamps."""
    steps = np.diff(time)
    moving = steps[steps > 0]
    return float(np.median(moving)) if len(moving) >= 10 else 0.0


def check_gaps(time: np.ndarray, where: str, gap: float) -> Iterator[Finding]:
    """Silences longer than `gap` [s]; where most steps are, these are no gaps: it is the rate, or another unit."""
    steps = np.diff(time)
    long = np.flatnonzero(steps > gap)
    if 2 * len(long) > len(steps):
        if likely_unit(time) is None:
            text = (
                f"{len(long)} of {len(steps)} rows come more than {gap:g} s after the one before, usually "
                f"{np.median(steps[long]):.4g} s: if the time column counts milliseconds, set time_unit = "
                '"ms" under [map]; if not, set `gap` above that under [episodes]'
            )
            yield Finding("warning", "gap", where, text)
    elif len(long):
        first = int(long[0])
        yield Finding(
            "warning",
            "gap",
            f"{where}, row {first + 1}",
            f"{len(long)} {'gap' if len(long) == 1 else 'gaps'} longer than {gap:g} s, the first "
            f"{steps[first]:.3f} s at {time[first]:.3f} s, the longest {steps.max():.3f} s; "
            'split there with by = "gaps" under [episodes]',
        )

"""Values of one channel: no numbers, glitches, units that cannot be, limits, wraps."""

from collections.abc import Iterator

import numpy as np

from dynreg.data.checks.counts import ASKED, GLITCHES, counted
from dynreg.data.outliers import bends, spikes
from dynreg.data.schema import ChannelSpec
from dynreg.data.series import Finding, Series

TURNS = 20.0  # [rad] an angle beyond this without stated limits is worth a word
BEYOND = 5.0  # times its limit: no scatter, another unit
LIMIT_MARGIN = 0.01  # share of the range
MANY = 0.25  # share of a log's rates that nobody misses without a word
VAGUE = 0.5  # of the usual size of a rate: an error beyond it leaves little to begin a replay with
WRAPPED = 0.3  # [rad] what is left of a step by a whole turn


def check_numbers(
    series: Series, where: str, dropped: np.ndarray | None = None, *, optional: bool = False
) -> Iterator[Finding]:
    """Values that are no numbers, but for those at the stamps `dropped` (N,), which the map wanted away.

    optional : whether an episode may do without the channel.
    """
    bad = ~np.isfinite(series.values)
    if bad.all():
        text = "holds no number at all" + ("; it is left out" if optional else "")
        yield Finding("warning" if optional else "error", "nan", where, text)
        return
    if dropped is not None and len(dropped):
        bad &= ~np.isin(series.time, dropped)
    if series.error is not None:
        yield from _check_rate(series, where, bad)
    elif bad.any():
        row = int(np.argmax(bad))
        text = f"{int(bad.sum())} of {len(bad)} values are NaN or infinite; they are left out"
        yield Finding("warning", "nan", f"{where}, row {row}, {series.time[row]:.3f} s", text)


def _check_rate(series: Series, where: str, unknown: np.ndarray) -> Iterator[Finding]:
    """A rate that was computed, of which the rows (T,) `unknown` are not told, and which may be of little use."""
    size = float(np.sqrt(np.mean(series.values[~unknown] ** 2)))
    if unknown.any():
        lost = f"{unknown.sum()} of {len(unknown)} rates are not known"
        text = f"{lost}: the signal turns too sharply there, or is silent"
        much = unknown.mean() > MANY
        do = "raise filter_hz in the map, if it has one, or log faster" if much else ""
        yield Finding("warning" if much else "info", "rate", where, text, do)
    if series.error > VAGUE * size:
        text = f"its rates of {size:.2g} (rms) are off by {series.error:.2g} (1 sigma)"
        yield Finding(
            "warning", "rate", where, text, "change filter_hz in the map, or log a measured velocity"
        )


def check_spikes(series: Series, where: str, table: str) -> Iterator[Finding]:
    """Single samples far from both neighbours: glitches of a bus or a register, not motion.

    table : the one in the map to which the cure is to be written, in words.
    """
    rows = spikes(series.values)
    if len(rows):
        heights = bends(series.values)[rows]
        far = int(np.argmax(np.abs(heights)))
        first = ", ".join(f"{series.time[r]:.3f} s" for r in rows[:3]) + (", ..." if len(rows) > 3 else "")
        text = (
            f"{len(rows)} single-sample {'spike' if len(rows) == 1 else 'spikes'} (at {first}), the largest by "
            f"{heights[far]:+.4g}{f' {series.unit}' if series.unit else ''} at {series.time[rows[far]]:.3f} s"
        )
        do = f'to leave {"it" if len(rows) == 1 else "them"} out, write outliers = "drop" in the map {table}'
        yield Finding("warning", "spike", f"{where}, row {int(rows[0])}", text, do)


def check_range(
    series: Series, channel: ChannelSpec, where: str, followed: bool = False
) -> Iterator[Finding]:
    """Units that cannot be, actions beyond their limits, angles that wrap.

    followed : the heading of a base whose commands are timed. It makes whole turns between two rows, which replays and
    comparisons follow by what was told; unwrapped from row to row it would be wrong.
    """
    values = series.values[np.isfinite(series.values)]
    if not len(values):
        return
    largest = float(np.abs(values).max())
    bounds = [abs(b) for b in (channel.low, channel.high) if b is not None and np.isfinite(b)]
    reached, limit = (largest, max(bounds)) if bounds else _beyond_stops(values, channel.stops)
    if limit > 0 and reached > BEYOND * limit:
        text = f"reaches {reached:.4g} {channel.unit}, {reached / limit:.3g} x its limit"
        other = "; degrees?" if channel.unit.startswith("rad") else "", "set `unit`"
        asked, do = (_counts_asked(values, limit) if channel.unit == "rad" else None) or other
        yield Finding("error", "units", where, f"{text}{asked}", do)
        return
    turned = float(np.abs(np.diff(values)).max(initial=0.0)) if followed else largest
    if channel.unit == "rad" and not bounds and turned > TURNS:
        text = f"reaches {largest:.4g} rad, {largest / (2 * np.pi):.3g} turns"
        asked, do = _counts_asked(values, np.inf) or (": degrees?", "")
        yield Finding("warning", "units", where, f"{text}{asked}", do)
    if channel.kind == "enable" and not (flags := np.isin(values, (0.0, 1.0))).all():
        text = f"a flag with values other than 0 and 1, such as {values[np.argmin(flags)]:.4g}"
        do = "correct its `source` in the map, or leave the channel out"
        yield Finding("error", "units", where, text, do)
    if channel.kind in ("action", "state") and channel.low is not None and channel.high is not None:
        margin = LIMIT_MARGIN * (channel.high - channel.low)
        out = (values < channel.low - margin) | (values > channel.high + margin)
        if out.any():
            limits = f"[{channel.low:g}, {channel.high:g}] {channel.unit}"
            text = f"{100 * out.mean():.1f} % of values lie beyond {limits}, as far as {largest:.4g}"
            if channel.kind == "action":
                text += (
                    "; replays cut them off there, as the drive is said to (`low` and `high` of the action)"
                )
            yield Finding("warning", "limits", where, text)
    if channel.unit == "rad" and channel.kind != "action" and largest < 7.0 and not followed:
        jumps = _wraps(values)
        if len(jumps):
            often = "once" if len(jumps) == 1 else f"{len(jumps)} times"
            text = f"jumps by a whole turn {often}"
            yield Finding(
                "warning", "wrap", f"{where}, row {int(jumps[0]) + 1}", text, "set unwrap = true in the map"
            )


def _counts_asked(values: np.ndarray, reach: float) -> tuple[str, str] | None:
    """The end of what is said of angles (T,) far beyond their `reach` [rad] that may be counts, and what to do."""
    counts = counted(values, reach)
    return (f", {counts.why}: {ASKED}", counts.do) if counts else None


def _wraps(values: np.ndarray) -> np.ndarray:
    """Rows of angles (T,) [rad] after which a whole turn is missing: what is left of the step is as small as others."""
    steps = np.abs(np.diff(values))
    long = steps > np.pi
    usual = float(np.quantile(steps[~long], 0.99)) if not long.all() else 0.0
    return np.flatnonzero(long & (np.abs(steps - 2 * np.pi) < max(WRAPPED, 2 * usual)))


def _beyond_stops(values: np.ndarray, stops: tuple[float, float] | None) -> tuple[float, float]:
    """How far from 0 the positions (T,) of a joint go, `GLITCHES` aside, and how far its stops let it.

    Both 0 where there are no stops, or the joint moves no further than from one to the other: its zero may then be
    elsewhere than the model's.
    """
    if stops is None:
        return 0.0, 0.0
    low, high = np.quantile(values, (GLITCHES / 2, 1.0 - GLITCHES / 2))
    if high - low <= stops[1] - stops[0]:
        return 0.0, 0.0
    return max(abs(low), abs(high)), max(map(abs, stops))

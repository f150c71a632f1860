"""Checks of a log: clocks, gaps, numbers, units, limits."""

import json
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from dynreg.data.base_frame import check_frame
from dynreg.data.episodes import RawEpisode
from dynreg.data.names import joint_of, quantity_of
from dynreg.data.outliers import bends, spikes
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Finding, Series

STANDSTILL_ROWS = 10  # rows with one and the same stamp that make a stopped clock
JITTER = 3.0  # 99th percentile over median period
STUCK_SHARE, STUCK_SECONDS = 0.2, 1.0
IN_VAIN = 3.0  # times what moved the joint elsewhere: neither friction nor a load holds it then
STUCK_WAY = 0.1  # way of the velocity, as a share of how far the position goes in all
SLOW_STEP = 2.0  # [s] between rows: a clock in another unit
LIKELY: Mapping[str, str] = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds"}
TURNS = 20.0  # [rad] an angle beyond this without stated limits is worth a word
BEYOND = 5.0  # times its limit: no scatter, another unit
GLITCHES = 0.01  # share of a joint's positions that may be anything, as where a bus fails
LIMIT_MARGIN = 0.01  # share of the range
WRAPPED = 0.3  # [rad] what is left of a step by a whole turn
AGREEMENT = (0.7, 1.4)  # slope of a velocity channel on the derivative of its position
MISTAKES: Mapping[str, float] = {
    "deg": 180 / np.pi,
    "rpm": 60 / (2 * np.pi),
    "turns": 1 / (2 * np.pi),
    "milli-": 1000.0,
}


def check_episode(episode: RawEpisode, spec: RecordingSpec, gap: float) -> tuple[Finding, ...]:
    """Everything that is found in one episode against the channels; `gap` [s] is a silence to report.

    Where control is timed there are none: a row stands where a command begins.
    """
    where = f"{episode.file}, episode {episode.name}"
    findings = [
        Finding("error", "missing", where, f"channel {c.name!r} is missing")
        for c in spec.channels
        if c.name not in episode.channels and not c.optional
    ]
    findings += [
        Finding("warning", "missing", where, f"setting {name!r} is not known")
        for name in spec.settings
        if name not in episode.settings and name not in spec.usual
    ]
    findings += episode.findings
    specs = {c.name: c for c in spec.channels}
    shown = {name: s for name, s in episode.channels.items() if not specs[name].hold}
    findings += check_clocks(episode.channels, where, None)
    findings += check_clocks(shown, where, None if spec.rate is None else gap, only_gaps=True)
    for name, series in episode.channels.items():
        here = f"{where}, {name}"
        findings += check_numbers(series, here, episode.dropped.get(name), optional=specs[name].optional)
        # an impact is over in a sample of a velocity; a position cannot come back so
        told = specs[name].kind in ("state", "input") and specs[name].unit not in ("rad/s", "m/s")
        findings += check_spikes(series, here, f"under [channels.{json.dumps(name)}]") if told else ()
        findings += check_range(
            series, specs[name], here, followed=spec.rate is None and quantity_of(name) == "yaw"
        )
    findings += _stuck_channels(episode, specs, where)
    findings += _velocities(episode, where)
    findings += check_frame(episode, where)
    findings += _short(episode, spec, where)
    return tuple(findings)


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
            f"the clock runs back by {-steps[row - 1]:.6g} s at {time[row - 1]:.6f} s ({len(back)} times); "
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
            else f"{int(equal.sum())} stamps repeat the one before; the last row of each stands",
        )
    moving, unit = steps[steps > 0], likely_unit(time)
    if unit is not None:
        text = f"{slow_clock(time, unit)}; set time_unit = {json.dumps(unit)} under [map]"
        yield Finding("warning", "clock", where, text)
    elif len(moving) >= 10:
        median, late = np.median(moving), np.quantile(moving, 0.99)
        if late > JITTER * median:
            text = f"uneven stamps: median {1e3 * median:.3g} ms, 99 % below {1e3 * late:.3g} ms"
            yield Finding("info", "jitter", where, text)


def likely_unit(time: np.ndarray) -> str | None:
    """The unit ("ms", "us" or "ns") of stamps (T,) whose steps are too long to be seconds; None for others."""
    step = _usual_step(time)
    if step <= SLOW_STEP:
        return None
    return "ns" if step > 2e5 else "us" if step > 200 else "ms"


def slow_clock(time: np.ndarray, unit: str) -> str:
    """What is said of stamps (T,) that count in this `likely_unit`."""
    return f"the median step is {_usual_step(time):.4g} s: the clock looks like {LIKELY[unit]}"


def _usual_step(time: np.ndarray) -> float:
    """The median step of a clock [s]; 0 for too few stamps."""
    steps = np.diff(time)
    moving = steps[steps > 0]
    return float(np.median(moving)) if len(moving) >= 10 else 0.0


def check_gaps(time: np.ndarray, where: str, gap: float) -> Iterator[Finding]:
    """Silences longer than `gap` [s]."""
    steps = np.diff(time)
    long = np.flatnonzero(steps > gap)
    if len(long):
        first = int(long[0])
        yield Finding(
            "warning",
            "gap",
            f"{where}, row {first + 1}",
            f"{len(long)} {'gap' if len(long) == 1 else 'gaps'} longer than {gap:g} s, the first "
            f"{steps[first]:.3f} s at {time[first]:.3f} s, the longest {steps.max():.3f} s; "
            'split there with by = "gaps" under [episodes]',
        )


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
    if bad.any():
        row = int(np.argmax(bad))
        text = f"{int(bad.sum())} of {len(bad)} values are NaN or infinite; they are left out"
        yield Finding("warning", "nan", f"{where}, row {row}, {series.time[row]:.3f} s", text)


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
            f"{heights[far]:+.4g}{f' {series.unit}' if series.unit else ''} at {series.time[rows[far]]:.3f} s; "
            f'to leave {"it" if len(rows) == 1 else "them"} out, write outliers = "drop" in the map {table}'
        )
        yield Finding("warning", "spike", f"{where}, row {int(rows[0])}", text)


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
        hint = "; degrees?" if channel.unit.startswith("rad") else ""
        text = f"reaches {reached:.4g} {channel.unit}, {reached / limit:.3g} x its limit{hint}; set `unit`"
        yield Finding("error", "units", where, text)
        return
    turned = float(np.abs(np.diff(values)).max(initial=0.0)) if followed else largest
    if channel.unit == "rad" and not bounds and turned > TURNS:
        text = f"reaches {largest:.4g} rad, {largest / (2 * np.pi):.3g} turns: degrees?"
        yield Finding("warning", "units", where, text)
    if channel.kind == "enable" and not np.all(np.isin(values, (0.0, 1.0))):
        yield Finding("warning", "units", where, "a flag with values other than 0 and 1")
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
            text = f"jumps by a whole turn {often}; set unwrap = true in the map"
            yield Finding("warning", "wrap", f"{where}, row {int(jumps[0]) + 1}", text)


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


def _stuck_channels(episode: RawEpisode, specs: Mapping[str, ChannelSpec], where: str) -> Iterator[Finding]:
    """States that keep one value while their joint is seen to move, or while its command pushes in vain.

    A servo that has settled, or is held by friction or by its load, keeps one value too.
    """
    for name, series in episode.channels.items():
        if specs[name].kind != "state" or len(series) < 3 or _position_of(name) in episode.channels:
            continue
        now, before = series.values[1:], series.values[:-1]
        start, run = longest_run((now == before) & np.isfinite(now))
        begin, end = series.time[start], series.time[start + run]
        if end - begin < max(STUCK_SECONDS, STUCK_SHARE * (series.time[-1] - series.time[0])):
            continue
        if _travels(name, series, episode, begin, end):
            why = "while its velocity says that it moves"
        elif any(_pushed(series, episode.channels[a], begin, end) for a in _commands(name, episode, specs)):
            why = "though its command pushes: the sensor is stuck, or the joint is"
        else:
            continue
        text = f"stays at {series.values[start]:.6g} from {begin:.3f} to {end:.3f} s {why}"
        yield Finding("warning", "stuck", f"{where}, {name}, row {start}", text)


def _commands(name: str, episode: RawEpisode, specs: Mapping[str, ChannelSpec]) -> list[str]:
    """The commands of the channel's joint; none where the drive is off at times."""
    enables = [n for n in episode.channels if specs[n].kind == "enable" and joint_of(n) == joint_of(name)]
    if any((episode.channels[n].values == 0).any() for n in enables):
        return []
    actions = [n for n in episode.channels if specs[n].kind == "action"]
    return [n for n in actions if joint_of(n) == joint_of(name)]


def _travels(name: str, position: Series, episode: RawEpisode, begin: float, end: float) -> bool:
    """Whether the joint's own velocity channel goes a way, from `begin` to `end` [s], that cannot stay unseen."""
    velocity = episode.channels.get(f"{joint_of(name)}/velocity")
    if velocity is None or quantity_of(name) != "position":
        return False
    inside = (velocity.time >= begin) & (velocity.time <= end) & np.isfinite(velocity.values)
    way = np.cumsum(velocity.values[inside][1:] * np.diff(velocity.time[inside]))
    straight = (
        np.ptp(way - np.linspace(0.0, way[-1], len(way))) if len(way) > 1 else 0.0
    )  # a bias is no motion
    return bool(straight > STUCK_WAY * np.nanmax(np.abs(position.values - np.nanmedian(position.values))))


def _pushed(position: Series, command: Series, begin: float, end: float) -> bool:
    """Whether a command pushed in vain: both ways by more than usually moves the joint, or far more than ever did.

    What pushes a servo is how far its command is from what is measured; elsewhere the command itself.
    """
    told = np.interp(position.time, command.time, command.values)
    same = position.unit == command.unit
    push = told - position.values if same else told
    inside = (position.time >= begin) & (position.time <= end)
    moved = np.append(np.diff(position.values) != 0, False) & ~inside & np.isfinite(push)
    held = push[inside & np.isfinite(push)]
    if not moved.any() or not len(held):
        return False
    enough = max(float(np.median(np.abs(push[moved]))), 0.1 * float(np.nanmax(np.abs(push))))
    most = IN_VAIN * float(np.quantile(np.abs(push[moved]), 0.99))
    return bool((held.min() < -enough and held.max() > enough) or (same and np.abs(held).max() > most))


def _position_of(name: str) -> str:
    """ "arm/position" for "arm/velocity", "" for other names."""
    return name.removesuffix("velocity") + "position" if quantity_of(name) == "velocity" else ""


def _velocities(episode: RawEpisode, where: str) -> Iterator[Finding]:
    """A velocity channel that is not the rate of its position."""
    for name, velocity in episode.channels.items():
        position = episode.channels.get(_position_of(name))
        if position is None:
            continue
        slope = velocity_slope(position, velocity)
        if slope is None or AGREEMENT[0] <= slope <= AGREEMENT[1]:
            continue
        unit = next((u for u, k in MISTAKES.items() for f in (k, 1 / k) if 0.85 < slope / f < 1.15), None)
        text = f"is {slope:.3g} times the rate of its position"
        told = f": one of the two is in {unit}; set `unit`" if unit else "; check its sign and unit"
        yield Finding("error" if unit else "warning", "units", f"{where}, {name}", text + told)


def velocity_slope(position: Series, velocity: Series) -> float | None:
    """Slope of a velocity signal on the rate of its position, both as mean values over 20 samples.

    The means of the rate are differences of position, so encoder steps hardly matter; single-sample spikes of both
    are left out. None where either hardly moves, or the two do not correlate (r < 0.8), so that nothing can be said.
    """
    rows, good = (_plain(series.values) for series in (position, velocity))
    time, values = position.time[rows], position.values[rows]
    if len(time) < 200 or good.sum() < 200 or np.any(np.diff(time) < 0) or np.any(np.diff(velocity.time) < 0):
        return None
    edges = time[:: max(len(time) // max(len(time) // 20, 1), 1)]
    spans = np.diff(edges)
    rate = np.diff(np.interp(edges, time, values))
    stamps, speeds = velocity.time[good], velocity.values[good]
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(stamps))])
    mean = np.diff(np.interp(edges, stamps, travel))
    keep = spans > 0
    rate, mean = rate[keep] / spans[keep], mean[keep] / spans[keep]
    if np.std(rate) == 0 or np.std(mean) == 0 or abs(np.corrcoef(rate, mean)[0, 1]) < 0.8:
        return None
    return float(np.dot(rate, mean) / np.dot(rate, rate))


def _plain(values: np.ndarray) -> np.ndarray:
    """(T,) whether a value is a number and no single-sample spike."""
    good = np.isfinite(values)
    good[spikes(values)] = False
    return good


def _short(episode: RawEpisode, spec: RecordingSpec, where: str) -> Iterator[Finding]:
    states = [episode.channels[c.name] for c in spec.channels if c.name in episode.channels and not c.hold]
    if not states:
        return
    duration = min(s.time[-1] - s.time[0] if len(s) else 0.0 for s in states)
    rows = min(len(s) for s in states)
    if rows < 2:
        yield Finding("error", "short", where, f"{rows} samples; at least 2 are needed")
    elif spec.rate is not None and duration * spec.rate < 10:
        yield Finding(
            "warning", "short", where, f"lasts {duration:.3f} s, less than 10 steps at {spec.rate:g} Hz"
        )
    elif spec.rate is not None and rows < 0.1 * duration * spec.rate:
        text = f"{rows / duration:.3g} samples/s for {spec.rate:g} Hz of control: is the clock in seconds?"
        yield Finding("warning", "rate", where, text)


def longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Start and length of the longest run of True.

    >>> longest_run(np.array([False, True, True, False, True]))
    (1, 2)
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    best = int(np.argmax(lengths))
    return int(edges[2 * best]), int(lengths[best])


def errors(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings that block ingestion."""
    return tuple(f for f in findings if f.severity == "error")

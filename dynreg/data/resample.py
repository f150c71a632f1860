"""Resampling from the log's own stamps to the robot's control rate; every change is reported."""

from collections.abc import Iterator

import numpy as np

from dynreg.data.derivative import GRID_LIMIT
from dynreg.data.episodes import RawEpisode
from dynreg.data.gaps import BRIDGED, silent
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import STAMP_TOLERANCE, Finding, Series, clean
from dynreg.errors import LogError
from dynreg.limits import limits, refuse

STREAM = 20  # changes of a signal from which on they may be a stream: fewer lie together by chance
NEARLY, MOST = 0.25, 0.95  # of a period, about the same part of which this share of a stream's changes comes
MUCH = 0.05  # share of an episode's time that is not left out without a word


def resample(episode: RawEpisode, spec: RecordingSpec) -> tuple[float, np.ndarray, np.ndarray]:
    """Bring an episode's channels to one time base.

    States and inputs are interpolated linearly; actions and flags hold their last value (see `_within`). Where a state
    is silent, or any signal has NaN, for longer than can be filled in (`gaps.silences`), it is NaN. The grid runs from
    the first stamp that all channels have reached to the last that none has left (flags and commands that are logged
    when they change stand until then), at `spec.rate`; without a rate it has the stamps of the first action.

    Returns
    -------
    start : [s] the first common stamp on the log's clock; it becomes time 0.
    time : (T,) [s] from 0.
    values : (T, C) in the order of `spec.channels`, NaN for channels that the episode does not have.

    Raises LogError where the channels have fewer than two samples in common.
    """
    series = _cleaned(episode)
    start, end = common_span(episode, series, spec)
    grid = _grid(episode, series, spec, start, end)
    values = np.full((len(grid), len(spec.channels)), np.nan)
    within = _within(series, spec, start)
    for column, channel in enumerate(spec.channels):
        if channel.name in series:
            kept = series[channel.name]
            counts = within.get(channel.name, STAMP_TOLERANCE)
            values[:, column] = at(clean(kept), start + grid, channel.hold, counts)
            raw = episode.channels[channel.name]
            values[_unknown(raw, kept.time, start + grid, channel, timed=spec.rate is None), column] = np.nan
    return start, grid, values


def _unknown(
    raw: Series, known: np.ndarray, time: np.ndarray, channel: ChannelSpec, *, timed: bool
) -> np.ndarray:
    """(T,) whether nobody knows a signal at `time`, whose numbers have the stamps `known`."""
    if raw.error is not None:
        before = np.searchsorted(raw.time, time + STAMP_TOLERANCE, side="right") - 1
        after = np.searchsorted(raw.time, time - STAMP_TOLERANCE)
        beside = np.clip([before, after], 0, len(raw) - 1)
        return ~np.isfinite(raw.values[beside]).all(axis=0)
    nothing = raw.time[~np.isfinite(raw.values)]
    if channel.hold and 2 * len(nothing) > len(raw):
        return np.zeros(len(time), dtype=bool)  # it is logged when it changes, and holds
    # a command holds until another comes, and so may an input that is logged when it changes; where control is timed, a
    # row stands where a command begins
    holds = channel.kind != "state" or timed
    return silent(known, time, nothing if holds else None)


def at(series: Series, time: np.ndarray, hold: bool, within: float = STAMP_TOLERANCE) -> np.ndarray:
    """(T,) values of a signal at `time`, held or interpolated; one that comes `within` [s] after it counts, too."""
    if not hold:
        return np.interp(time, series.time, series.values)
    last = np.searchsorted(series.time, time + within, side="right") - 1
    return series.values[np.maximum(last, 0)]


def _within(series: dict[str, Series], spec: RecordingSpec, start: float) -> dict[str, float]:
    """{held channel: how long after a row of the grid what it says still counts for that row [s]}.

    A stream of commands comes at nearly the same part of a period, before or after the row as its stamps scatter. There
    each counts for the nearest row, so that none moves to another. Signals that share stamps are parted alike. What
    changes seldom, or comes at any part of a period, counts from the next row on.
    """
    if spec.rate is None:
        return {}
    shared: dict[bytes, dict[str, Series]] = {}
    for name in (c.name for c in spec.channels if c.hold and c.name in series):
        held = clean(series[name])
        shared.setdefault(held.time.tobytes(), {})[name] = held
    out = {}
    for held in shared.values():
        new = np.any([np.diff(one.values) != 0 for one in held.values()], axis=0)
        parts = (next(iter(held.values())).time[1:][new] - start) * spec.rate
        if len(parts) < STREAM:
            continue
        middle = float(np.angle(np.exp(2j * np.pi * parts).mean()) / (2 * np.pi))
        off = np.abs((parts - middle + 0.5) % 1.0 - 0.5)
        if np.mean(off < NEARLY) >= MOST:
            out |= dict.fromkeys(held, max(((middle + 0.5) % 1.0) / spec.rate, STAMP_TOLERANCE))
    return out


def common_span(episode: RawEpisode, series: dict[str, Series], spec: RecordingSpec) -> tuple[float, float]:
    """First and last stamp [s] between which every channel is known; LogError where there is no time between."""
    begins, ends = _edges(series, spec)
    start, end = max(begins.values(), default=0.0), min(ends.values(), default=0.0)
    if not end > start:
        late = max(begins, key=lambda n: begins[n], default="?")
        early = min(ends, key=lambda n: ends[n], default="?")
        raise LogError(
            f"{episode.file}, episode {episode.name!r}: {early!r} ends at {end:.3f} s, "
            f"before {late!r} begins at {start:.3f} s",
            expected="channels that overlap in time",
            do="check their clocks, or set `delay` in the map",
        )
    return float(start), float(end)


def check_span(episode: RawEpisode, spec: RecordingSpec) -> Iterator[Finding]:
    """What is to be said where much of an episode is left out, because a channel begins late or ends early."""
    begins, ends = _edges(_cleaned(episode), spec)
    start, end = max(begins.values()), min(ends.values())
    first, last = min(begins.values()), max(ends.values())
    if spec.rate is None:
        return
    yield from _held_long(episode, spec, end, MUCH * (last - first))
    lost = start - first + last - end
    if lost <= MUCH * (last - first):
        return
    late, early = max(begins, key=lambda n: begins[n]), min(ends, key=lambda n: ends[n])
    text = (
        f"{lost:.3g} of {last - first:.3g} s are left out, for not every channel is known there: {late!r} begins at "
        f"{begins[late]:.3f} s, {early!r} ends at {ends[early]:.3f} s"
    )
    yield Finding("warning", "span", f"{episode.file}, episode {episode.name}", text)


def _held_long(episode: RawEpisode, spec: RecordingSpec, end: float, much: float) -> Iterator[Finding]:
    """Commands that nobody sent for so many seconds at the end, and that are taken to hold."""
    for channel in spec.channels:
        series = clean(episode.channels.get(channel.name, Series(np.empty(0), np.empty(0))))
        if channel.kind == "action" and len(series) and end - series.time[-1] > much:
            last = float(series.time[-1])
            text = f"the last command comes at {last:.3f} s and is taken to hold for {end - last:.3g} s"
            where = f"{episode.file}, episode {episode.name}, {channel.name}"
            yield Finding(
                "warning", "span", where, text, "cut the log there where the robot stopped listening"
            )


def _cleaned(episode: RawEpisode) -> dict[str, Series]:
    """The channels of which anything is known; a computed rate spans what it was computed from."""
    series = {name: clean(s) if s.error is None else s for name, s in episode.channels.items()}
    return {name: s for name, s in series.items() if np.isfinite(s.values).any()}


def _edges(series: dict[str, Series], spec: RecordingSpec) -> tuple[dict[str, float], dict[str, float]]:
    """{channel: stamp [s]} from which on it is known, and up to which; not of those whose last value stands."""
    kinds = {c.name: c.kind for c in spec.channels}
    begins = {name: float(s.time[0]) for name, s in series.items()}
    last = {name: float(s.time[-1]) for name, s in series.items()}
    return begins, {n: at for n, at in last.items() if not _stands(series[n], kinds[n])} or last


def _stands(series: Series, kind: str) -> bool:
    """Whether the last value of a signal stands until the log ends; a stream of commands has ended with its last."""
    if kind == "enable":
        return True
    return kind == "action" and (len(series) < 2 or float(np.median(np.diff(series.time))) > BRIDGED)


def _grid(
    episode: RawEpisode, series: dict[str, Series], spec: RecordingSpec, start: float, end: float
) -> np.ndarray:
    if spec.rate is None:
        names = [c.name for c in spec.channels if c.kind == "action"] + [c.name for c in spec.channels]
        base = series[next(name for name in names if name in series)].time
        grid = base[(base >= start) & (base <= end)] - start
    else:
        most = (
            np.floor((end - start) * spec.rate + STAMP_TOLERANCE * spec.rate) + 1
        )  # of far stamps, infinite
        logged = max(len(s) for s in series.values())
        if most > max(GRID_LIMIT, 200 * logged):
            raise LogError(
                f"{episode.file}, episode {episode.name!r}: {logged} samples over {end - start:.4g} s "
                f"would become {most:.0f} rows at {spec.rate:g} Hz",
                expected="a clock in seconds",
                do='set time_unit = "ms", "us" or "ns" under [map]',
            )
        rows = int(most)
        if rows * len(spec.channels) > limits().numbers:
            asked = f"{episode.file}, episode {episode.name!r}, becomes more numbers than are kept"
            refuse(LogError, asked, rows * len(spec.channels), "numbers")
        grid = np.arange(rows) / spec.rate
    if len(grid) < 2:
        raise LogError(
            f"{episode.file}, episode {episode.name!r} has {len(grid)} samples in common to all channels",
            expected="at least 2",
            do="record a longer run, leave this file out, or correct time_unit under [map] if it is longer",
        )
    return grid

"""From a raw log and a map to episodes: named channels in SI units on the log's own stamps."""

import string
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynreg.data.gaps import silent
from dynreg.data.maps import LogMap, SettingMap, factors
from dynreg.data.patterns import search
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import RawLog, Series
from dynreg.errors import LogError, MapError

FILTER_ORDER = 2

Select = Callable[[Series], Series]


@dataclass(frozen=True)
class RawEpisode:
    """One run before resampling: each channel on the stamps on which it was logged, and its settings."""

    name: str
    file: str
    channels: Mapping[str, Series]
    settings: Mapping[str, float] = field(default_factory=dict)


def raw_episodes(log: RawLog, log_map: LogMap, spec: RecordingSpec) -> tuple[RawEpisode, ...]:
    """The episodes of one log, in the robot's channels and units.

    Raises MapError for a source that the log does not hold, LogError where a column splits nothing.
    """
    out = []
    for part, select in _parts(log, log_map):
        channels = _channels(log, log_map, spec, select)
        settings = _settings(log, log_map, select)
        name = _name(log, log_map, settings, part)
        out.append(RawEpisode(name, log.path.name, channels, settings))
    if log_map.episodes.by == "gaps":
        out = [piece for episode in out for piece in _split_at_gaps(episode, log_map.episodes.gap)]
    return tuple(_differentiated(episode, log_map, spec) for episode in out)


def _parts(log: RawLog, log_map: LogMap) -> Iterator[tuple[str | None, Select]]:
    """Name of each episode and what picks its part of a series.

    A table's column marks its rows. A message's field marks time: it holds until the next message.
    """
    column = log_map.episodes.column
    if column is None:
        yield None, lambda series: series
        return
    if column in log.labels:
        keys, marks = np.asarray(log.labels[column]), None
    elif column in log.sources:
        marks = log.sources[column]
        keys = marks.values
        if all(len(s) == len(marks) and np.array_equal(s.time, marks.time) for s in log.sources.values()):
            marks = None
    else:
        raise LogError(
            f"{log.path.name!r} has no episode column {column!r}",
            expected=f"one of {[*log.names][:20]}",
            do="correct `column` under [episodes]",
        )
    _, first = np.unique(keys, return_index=True)
    for key in keys[np.sort(first)]:
        text = f"{key:g}" if isinstance(key, float) else str(key)
        if marks is None:
            yield text, lambda series, rows=keys == key: series.rows(rows)
        else:
            yield text, lambda series, key=key: series.rows(_mark(marks, series.time) == key)


def _mark(marks: Series, time: np.ndarray) -> np.ndarray:
    """(T,) the mark that holds at each time; NaN before the first."""
    last = np.searchsorted(marks.time, time, side="right") - 1
    return np.where(last >= 0, marks.values[np.maximum(last, 0)], np.nan)


def _channels(log: RawLog, log_map: LogMap, spec: RecordingSpec, select: Select) -> dict[str, Series]:
    out = {}
    for channel in spec.channels:
        entry = log_map.channels.get(channel.name)
        if entry is None or entry.source is None:
            continue  # absent, or differentiated later from a channel of this episode
        if entry.source in log.sources:
            # in the channel's unit, on stamps without its delay
            series = select(log.sources[entry.source])
            if entry.unit is None and series.unit is not None:
                entry = entry.model_copy(update={"unit": series.unit})
            factor, offset = factors(entry, channel)
            values = series.values * factor + offset
            if entry.unwrap:
                good = np.isfinite(values)
                values[good] = np.unwrap(values[good])
            out[channel.name] = Series(series.time - entry.delay, values, channel.unit)
        elif not channel.optional:
            near = [name for name in log.names if name.split(".")[0] == entry.source.split(".")[0]]
            near = near or log.metadata.get("topics") or [*log.names]
            raise MapError(
                f"{log.path.name!r} has no source {entry.source!r} for channel {channel.name!r}",
                expected=f"one of {near[:30]}",
                do="correct `source` in the map, or run `dynreg doctor` on the log to list what it holds",
            )
    return out


def _settings(log: RawLog, log_map: LogMap, select: Select) -> dict[str, float]:
    out = {}
    for name, entry in log_map.settings.items():
        value = _setting(entry, log, select)
        value = entry.default if value is None else value
        if value is not None:
            out[name] = entry.scale * value
    return out


def _setting(entry: SettingMap, log: RawLog, select: Select) -> float | None:
    if entry.value is not None:
        return entry.value
    if entry.filename is not None:
        text: Any = search(entry.filename, log.path.stem).found
    elif entry.metadata in log.metadata:
        text = log.metadata[entry.metadata]
    elif entry.metadata in log.sources:
        values = select(log.sources[entry.metadata]).values
        distinct = np.unique(values[np.isfinite(values)])
        if len(distinct) > 1:
            both = f"{distinct[0]:g} and {distinct[1]:g}"
            raise LogError(
                f"{log.path.name!r}: setting {entry.metadata!r} is {both} in one episode",
                expected="one value an episode",
                do="split the episodes where it changes",
            )
        text = distinct[0] if len(distinct) else None
    elif entry.metadata in log.labels:
        text = log.labels[entry.metadata][0]
    else:
        return None
    try:
        return None if text is None else float(text)
    except (TypeError, ValueError):
        raise LogError(
            f"{log.path.name!r}: the setting {entry.metadata or entry.filename!r} reads as {str(text)!r}",
            expected="a number",
            do="correct it in the log, or [settings] in the map",
        ) from None


def _name(log: RawLog, log_map: LogMap, settings: Mapping[str, float], part: str | None) -> str:
    if log_map.episodes.name is None:
        return part if part is not None else log.path.stem
    known = {**log.metadata, **settings, "stem": log.path.stem, "episode": part or ""}
    try:
        return string.Formatter().vformat(log_map.episodes.name, (), known)
    except (KeyError, ValueError) as error:
        raise MapError(
            f"the episode name {log_map.episodes.name!r} cannot be made: {error}",
            expected=f"names among {sorted(known)}",
            do="correct `name` under [episodes]",
        ) from None


def _split_at_gaps(episode: RawEpisode, gap: float) -> list[RawEpisode]:
    """Cut where any channel is silent for longer than `gap` [s] or its clock runs back.

    Channels that are only held (commands) do not count: a command may stand for long.
    """
    longest = max(episode.channels.values(), key=len)
    steps = np.diff(longest.time)
    cuts = np.flatnonzero((steps > gap) | (steps < 0))
    if not len(cuts):
        return [episode]
    edges = np.concatenate([[0], cuts + 1, [len(longest)]])
    pieces = []
    for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        channels = {}
        for name, series in episode.channels.items():
            if len(series) == len(longest) and np.array_equal(series.time, longest.time):
                channels[name] = series.rows(slice(a, b))
            else:  # on another clock rate: cut by time
                inside = (series.time >= longest.time[a] - gap) & (series.time <= longest.time[b - 1] + gap)
                channels[name] = series.rows(inside)
        if b - a > 1:
            pieces.append(replace(episode, name=f"{episode.name}_{i + 1}", channels=channels))
    return pieces


def _differentiated(episode: RawEpisode, log_map: LogMap, spec: RecordingSpec) -> RawEpisode:
    channels = dict(episode.channels)
    for channel in spec.channels:
        entry = log_map.channels.get(channel.name)
        if entry is None or entry.derivative_of is None:
            continue
        origin = channels.get(entry.derivative_of)
        if origin is not None:
            slope = derivative(origin, entry.filter_hz)
            values = slope.values * entry.scale + entry.offset
            channels[channel.name] = Series(slope.time - entry.delay, values, channel.unit)
    return replace(episode, channels=channels)


def derivative(series: Series, filter_hz: float | None) -> Series:
    """Rate of change of a signal: zero-phase Butterworth low-pass, then central differences.

    The filter (order 2, run forwards and backwards: order 4 and no lag) acts on a uniform grid at the median
    period, so irregular stamps are first interpolated. Rows without a finite value are left out, but where they are
    too many to be filled in (`gaps.silences`) there is no rate either: NaN. Raises LogError where `filter_hz` is not
    below half the sampling rate.
    """
    from scipy.signal import butter, sosfiltfilt

    good = np.isfinite(series.values) & np.concatenate([[True], np.diff(series.time) > 0])
    time, values = series.time[good], series.values[good]
    nothing = np.unique(series.time[~np.isfinite(series.values)])
    if len(time) < 3:
        return Series(time, np.full(len(time), np.nan), series.unit)
    if filter_hz is None:
        empty = nothing[silent(time, nothing, nothing)]
        slope = np.concatenate([np.gradient(values, time), np.full(len(empty), np.nan)])
        every = np.concatenate([time, empty])
        order = np.argsort(every, kind="stable")
        return Series(every[order], slope[order], series.unit)
    period = float(np.median(np.diff(time)))
    if filter_hz >= 0.5 / period:
        raise LogError(
            f"filter_hz = {filter_hz:g} for a signal sampled at {1 / period:.4g} Hz",
            expected=f"less than {0.5 / period:.4g} Hz",
            do="lower filter_hz in the map",
        )
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + 1e-6) + 1)
    smooth = sosfiltfilt(
        butter(FILTER_ORDER, filter_hz, fs=1.0 / period, output="sos"),
        np.interp(grid, time, values),
        padlen=min(3 * (FILTER_ORDER + 1), len(grid) - 1),
    )
    slope = np.where(silent(time, nothing, grid), np.nan, np.gradient(smooth, period))
    return Series(grid, slope, series.unit)

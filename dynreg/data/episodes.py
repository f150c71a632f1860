"""From a raw log and a map to episodes: named channels in SI units on the log's own stamps."""

import string
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynreg.data.attitude import euler
from dynreg.data.derivative import derivative
from dynreg.data.maps import ChannelMap, LogMap, SettingMap, factors, of_text
from dynreg.data.outliers import far_from_median, spikes
from dynreg.data.patterns import search
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import SECONDS, Counting, Finding, RawLog, Series
from dynreg.errors import LogError, MapError, one_of, quoted
from dynreg.limits import limits, refuse

Select = Callable[[Series], Series]


@dataclass(frozen=True)
class RawEpisode:
    """One run before resampling: each channel on the stamps on which it was logged, and its settings.

    clock : [s] the absolute time at which the log's stamps are 0. log : number of the log among those read with it.
    findings : what the map had dropped. dropped : {channel: stamps [s] of the values that it had dropped}.
    counting : how the log's clock counts.
    """

    name: str
    file: str
    channels: Mapping[str, Series]
    settings: Mapping[str, float] = field(default_factory=dict)
    clock: float = 0.0
    log: int = 0
    findings: tuple[Finding, ...] = ()
    dropped: Mapping[str, np.ndarray] = field(default_factory=dict)
    counting: Counting | None = SECONDS


def raw_episodes(log: RawLog, log_map: LogMap, spec: RecordingSpec) -> tuple[RawEpisode, ...]:
    """The episodes of one log, in the robot's channels and units.

    Raises MapError for a source or an episode column that the log does not hold, LogError for what it holds wrongly.
    """
    out = []
    parts, aside = _parts(log, log_map)
    if not parts:
        raise LogError(
            f"column {_episode_column(log, log_map)!r} of {log.path.name!r} is empty in every row",
            expected="a number or a name in the rows of each episode",
            do="correct `column` under [episodes]",
        )
    for part, select in parts:
        logged = _channels(log, log_map, spec, select)
        settings = _settings(log, log_map, select)
        name = _name(log, log_map, settings, part)
        where = f"{log.path.name}, episode {name}"
        kept = {
            key: _kept(series, log_map.channels[key], f"{where}, {key}") for key, series in logged.items()
        }
        channels = {key: series for key, (series, _) in kept.items()}
        found = (*([] if out else aside), *(finding for _, more in kept.values() for finding in more))
        dropped = {key: _lost(logged[key], series) for key, series in channels.items()}
        out.append(
            RawEpisode(
                *(name, log.path.name, channels, settings, log.start),
                findings=found,
                dropped=dropped,
                counting=log.counting,
            )
        )
    if log_map.episodes.by == "gaps":
        held = {c.name for c in spec.channels if c.hold}
        out = [piece for episode in out for piece in _split_at_gaps(episode, log_map.episodes.gap, held)]
    return tuple(_differentiated(episode, log_map, spec) for episode in out)


def _parts(log: RawLog, log_map: LogMap) -> tuple[list[tuple[str | None, Select]], tuple[Finding, ...]]:
    """Name of each episode and what picks its part of a series, and what is said of the rows between episodes.

    A table's column marks its rows. A message's field marks time: it holds until the next message. Rows whose cell is
    empty, such as those between two runs, belong to none.
    """
    column = _episode_column(log, log_map)
    if column is None:
        return [(None, lambda series: series)], ()
    keys, marks = _keys(log, column)
    distinct, first, counts = np.unique(keys, return_index=True, return_counts=True)
    if len(distinct) > limits().episodes:
        refuse(
            LogError,
            f"column {column!r} of {log.path.name!r} makes more episodes than are read",
            len(distinct),
            "episodes",
        )
    rows, names = _Rows(keys, distinct, marks), [_key_name(key) for key in distinct]
    parts = [
        (names[number], lambda series, number=number: series.rows(rows.of(series, number)))
        for number in np.argsort(first).tolist()
        if names[number]
    ]
    empty = sum(int(count) for name, count in zip(names, counts, strict=True) if not name)
    text = f"{empty} of {len(keys)} rows name no episode: they are left out"
    return parts, (Finding("info", "left_out", f"{log.path.name}, {column}", text),) if empty else ()


def _key_name(key: Any) -> str:
    """The name of an episode by its cell, with all of its digits; "" of an empty cell.

    >>> _key_name(20240115.0), _key_name(0.5), _key_name(7), _key_name("fast"), _key_name(np.nan)
    ('20240115', '0.5', '7', 'fast', '')
    """
    if not isinstance(key, float):
        return str(key) if str(key).strip() else ""
    return "" if np.isnan(key) else repr(float(key)).removesuffix(".0")


def _keys(log: RawLog, column: str) -> tuple[np.ndarray, Series | None]:
    """The cells of an episode column, and its series where it marks time; None where it marks a table's rows."""
    if column in log.labels:
        keys, marks = np.asarray(log.labels[column]), None
        other = next((name for name, s in log.sources.items() if len(s) != len(keys)), None)
        if other is not None:
            raise MapError(
                f"{log.path.name!r}: {column!r} has no text for the {len(log.sources[other])} rows of {other!r}",
                expected="a column of numbers, which tell the episodes of signals on other clocks, too",
                do="number the episodes, and name that column under [episodes]",
            )
        return keys, marks
    if column in log.sources:
        marks = log.sources[column]
        keys = marks.values
        if all(len(s) == len(marks) and np.array_equal(s.time, marks.time) for s in log.sources.values()):
            marks = None
        return keys, marks
    raise MapError(
        f"{log.path.name!r} has no episode column {column!r}",
        expected=one_of(log.names, column),
        do="correct `column` under [episodes]",
    )


def _episode_column(log: RawLog, log_map: LogMap) -> str | None:
    """The column that tells episodes apart: the map's, else that of a format which has one, such as LeRobot's."""
    told = log_map.episodes
    return told.column if "by" in told.model_fields_set else log.metadata.get("episode_column")


def episodes_of(log: RawLog) -> tuple[RawLog, ...]:
    """A log of a format that tells episodes apart by a column, in these; each has its clock. Else the log itself."""
    if log.metadata.get("episode_column") is None:
        return (log,)
    out = []
    for name, select in _parts(log, LogMap(channels={}))[0]:
        sources = {key: select(series) for key, series in log.sources.items()}
        out.append(replace(log, path=log.path.with_name(f"{log.path.name}, episode {name}"), sources=sources))
    return tuple(out)


class _Rows:
    """Which rows of a series belong to each of the distinct keys, found once a series and not once an episode."""

    def __init__(self, keys: np.ndarray, distinct: np.ndarray, marks: Series | None):
        self._keys, self._distinct, self._marks = keys, distinct, marks
        self._found: dict[int, tuple[Series, np.ndarray, np.ndarray]] = {}

    def of(self, series: Series, number: int) -> np.ndarray:
        """(N,) row numbers of the key with this number."""
        about = (
            id(series) if self._marks is not None else 0
        )  # a table's rows are the same for all its columns
        if about not in self._found:
            keys = self._keys if self._marks is None else _mark(self._marks, series.time)
            numbers = np.searchsorted(self._distinct, keys)
            order = np.argsort(numbers, kind="stable")
            self._found[about] = (
                series,
                order,
                np.searchsorted(numbers[order], np.arange(len(self._distinct) + 1)),
            )
        _, order, begin = self._found[about]
        return order[begin[number] : begin[number + 1]]


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
        missing = [name for name in entry.sources if name not in log.sources]
        if not missing:
            out[channel.name] = _channel(log, entry, channel, select)
        elif not channel.optional:
            raise _no_source(log, missing[0], channel.name)
    return out


def _channel(log: RawLog, entry: ChannelMap, channel: ChannelSpec, select: Select) -> Series:
    """A channel in its unit, on stamps without its delay."""
    if entry.angle is None:
        series = select(log.sources[entry.sources[0]])
    else:
        series = euler([select(log.sources[name]) for name in entry.sources], entry.angle, channel.name)
    if entry.unit is None and series.unit is not None:
        entry = entry.model_copy(update={"unit": series.unit})
    factor, offset = factors(entry, channel)
    values = series.values * factor + offset
    if entry.unwrap:
        good = np.isfinite(values)
        values[good] = np.unwrap(values[good])
    return Series(series.time - entry.delay, values, channel.unit)


def _kept(series: Series, entry: ChannelMap, where: str) -> tuple[Series, tuple[Finding, ...]]:
    """A channel without the values that its map drops, and what was dropped or clipped."""
    values, told = series.values.copy(), []
    if entry.valid is not None:
        out = (values < entry.valid[0]) | (values > entry.valid[1])
        told += [f"{int(out.sum())} beyond `valid`"] if out.any() else []
        values[out] = np.nan
    if entry.outliers is not None:
        rows = spikes(values) if entry.outliers == "drop" else far_from_median(values, float(entry.outliers))
        told += [f"{len(rows)} as `outliers`"] if len(rows) else []
        values[rows] = np.nan
    findings = [f"values are dropped: {', '.join(told)}"] if told else []
    if entry.clip is not None:
        out = (values < entry.clip[0]) | (values > entry.clip[1])
        findings += [f"{int(out.sum())} values are clipped"] if out.any() else []
        values = np.clip(values, *entry.clip)
    if not findings:
        return series, ()
    kept = Series(series.time, values, series.unit)
    return kept, tuple(Finding("info", "dropped", where, text) for text in findings)


def _lost(before: Series, after: Series) -> np.ndarray:
    """(N,) stamps [s] of the values that a map dropped."""
    return after.time[np.isfinite(before.values) & np.isnan(after.values)]


def _no_source(log: RawLog, source: str, channel: str) -> MapError:
    if source in log.labels:
        return of_text(log, source)
    near = [name for name in log.names if name.split(".")[0] == source.split(".")[0]]
    near = near or log.metadata.get("topics") or [*log.names]
    return MapError(
        f"{log.path.name!r} has no source {source!r} for channel {channel!r}",
        expected=one_of(near, source),
        do="correct `source` in the map, or run `dynreg doctor` on the log to list what it holds",
    )


def _settings(log: RawLog, log_map: LogMap, select: Select) -> dict[str, float]:
    out = {}
    for name, entry in log_map.settings.items():
        value = _setting(entry, log, select)
        value = entry.default if value is None else value
        if value is not None:
            out[name] = entry.scale * value + entry.offset
    return out


def _setting(entry: SettingMap, log: RawLog, select: Select) -> float | None:
    if entry.value is not None:
        return entry.value
    if entry.filename is not None:
        text: Any = search(entry.filename, log.stem).found
    elif entry.metadata in log.metadata:
        text = log.metadata[entry.metadata]
    elif entry.metadata in log.sources:
        values = select(log.sources[entry.metadata]).values
        distinct = np.unique(values[np.isfinite(values)])
        if len(distinct) > 1:
            raise _two_settings(log, entry.metadata, f"{distinct[0]:g}", f"{distinct[1]:g}")
        text = distinct[0] if len(distinct) else None
    elif entry.metadata in log.labels:
        told = log.labels[entry.metadata]
        rows = np.arange(len(told), dtype=float)
        distinct = list(dict.fromkeys(told[int(row)] for row in select(Series(rows, rows)).values))
        if len(distinct) > 1:
            raise _two_settings(log, entry.metadata, *map(repr, distinct[:2]))
        text = distinct[0] if len(distinct) else None
    else:
        return None
    try:
        return None if text is None else float(text)
    except (TypeError, ValueError, OverflowError):
        raise LogError(
            f"{log.path.name!r}: the setting {entry.metadata or entry.filename!r} reads as {str(text)!r}",
            expected="a number",
            do="correct it in the log, or [settings] in the map",
        ) from None


def _two_settings(log: RawLog, name: str, first: str, second: str) -> LogError:
    return LogError(
        f"{log.path.name!r}: setting {name!r} is {first} and {second} in one episode",
        expected="one value an episode",
        do="split the episodes where it changes",
    )


def _name(log: RawLog, log_map: LogMap, settings: Mapping[str, float], part: str | None) -> str:
    if log_map.episodes.name is None:
        return part if part is not None else log.stem
    known = {**log.metadata, **settings, "stem": log.stem, "episode": part or ""}
    try:
        return string.Formatter().vformat(log_map.episodes.name, (), known)
    except (LookupError, ValueError, TypeError, OverflowError) as error:
        raise MapError(
            f"the episode name {log_map.episodes.name!r} cannot be made: {error}",
            expected=f"names among {quoted(sorted(known))}",
            do="correct `name` under [episodes]",
        ) from None


def _split_at_gaps(episode: RawEpisode, gap: float, held: Collection[str] = ()) -> list[RawEpisode]:
    """Cut where the channel with the most rows is silent for longer than `gap` [s], or its clock runs back.

    held : channels whose last value stands, such as commands: a silence of theirs is no gap, and what stands before a
    piece stands at its begin, too.
    """
    measured = [series for name, series in episode.channels.items() if name not in held]
    longest = max(measured or episode.channels.values(), key=len)
    steps = np.diff(longest.time)
    cuts = np.flatnonzero((steps > gap) | (steps < 0))
    if not len(cuts):
        return [episode]
    if len(cuts) >= limits().episodes:
        refuse(LogError, f"{episode.file!r} makes more episodes than are read", len(cuts) + 1, "episodes")
    edges = np.concatenate([[0], cuts + 1, [len(longest)]])
    pieces = []
    for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        channels = {}
        for name, series in episode.channels.items():
            begin, end = longest.time[a], longest.time[b - 1]
            if len(series) == len(longest) and np.array_equal(series.time, longest.time):
                channels[name] = series.rows(slice(a, b))
            else:  # on another clock rate: cut by time
                channels[name] = _between(series, begin - gap, end + gap)
            if name in held:
                channels[name] = _standing(series, channels[name], begin)
        if b - a > 1:
            pieces.append(replace(episode, name=f"{episode.name}_{i + 1}", channels=channels))
    return pieces


def _standing(series: Series, piece: Series, begin: float) -> Series:
    """A piece of a held signal, with the value before it that stands at `begin` [s]; of a clock that runs on."""
    piece = piece.rows(np.isfinite(piece.values))
    if (len(piece) and piece.time[0] <= begin) or np.any(np.diff(series.time) < 0):
        return piece
    before = np.flatnonzero((series.time <= begin) & np.isfinite(series.values))
    if not len(before):
        return piece
    time, values = np.append(begin, piece.time), np.append(series.values[before[-1]], piece.values)
    return Series(time, values, series.unit)


def _between(series: Series, begin: float, end: float) -> Series:
    """The rows from `begin` to `end` [s]; a clock that runs on is not looked through whole for each piece."""
    if np.all(series.time[1:] >= series.time[:-1]):
        first, last = np.searchsorted(series.time, begin, "left"), np.searchsorted(series.time, end, "right")
        return series.rows(slice(first, last))
    return series.rows((series.time >= begin) & (series.time <= end))


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
            told = {"unit": channel.unit, "error": slope.error * abs(entry.scale)}
            channels[channel.name] = replace(slope, time=slope.time - entry.delay, values=values, **told)
    return replace(episode, channels=channels)

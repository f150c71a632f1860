"""Log files become a Recording: they are read, mapped, checked and resampled, and the provenance says how."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.behaviour import check_behaviour
from dynreg.data.checks import check_clocks, check_episode, check_lengths, check_numbers, check_spikes, errors
from dynreg.data.checks.clock import coarse
from dynreg.data.clocks import Span, laid
from dynreg.data.drafting import as_logged
from dynreg.data.episodes import RawEpisode, episodes_of, raw_episodes
from dynreg.data.maps import DEFAULT_GAP, LogMap, check_map, identity_map
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.readers.merge import side_by_side
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.resample import check_span, resample
from dynreg.data.schema import RecordingSpec
from dynreg.data.senders import clocked, shared, signals_of
from dynreg.data.series import Finding, RawLog
from dynreg.data.words import steady
from dynreg.errors import CheckError, DynregError, LogError, MapError, one_of
from dynreg.foreign import visible

__all__ = ["Finding", "RawLog", "doctor", "examine", "read_log", "read_recording"]

Paths = Sequence[str | Path] | str | Path


# A stranger's numbers may overflow what is computed of them; the checks then find them not finite, and say so.
_overflowing = np.errstate(over="ignore", invalid="ignore", divide="ignore")


@_overflowing
def read_recording(paths: Paths, spec: RecordingSpec, log_map: LogMap | None = None) -> Recording:
    """Ingest one or several logs as one measured Recording at the robot's control rate.

    Without a map the logs are tables whose columns have the names of the robot's channels (and `time`,
    perhaps `episode` and settings); the provenance then has the map of the first log, or of the
    first that has `episode`. Channels are in `spec` order; optional ones that no episode has are left
    out. Episodes are ordered as `clocks.laid` says. `time` of each tells the rest before it; where that is not known
    it begins at 0 again. Warnings, file hashes, the map, the resampling and the absolute begins (`clocks` [s]) go to
    the provenance.

    Raises LogError for a log that cannot be read or that a check refuses, MapError for a map that does not
    fit the robot or the log.
    """
    files = _expand(paths)
    episodes, findings, log_map = _mapped(files, spec, log_map)
    _refuse(files, episodes, findings)
    read = [_Placed(raw, *resample(raw, spec)) for raw in episodes]
    order = laid([p.span for p in read])
    placed = [read[k] for k in order.order]
    names = _names([p.raw for p in placed])
    kept = [
        (name, begin + p.time, p.values, p.raw.settings)
        for name, p, begin in zip(names, placed, order.begins, strict=True)
    ]
    present = np.any([np.isfinite(values).any(axis=0) for _, _, values, _ in kept], axis=0)
    channels = tuple(
        Channel(c.name, c.unit) for c, there in zip(spec.channels, present, strict=True) if there
    )
    findings += [finding for p in placed for finding in check_span(p.raw, spec)]
    provenance = {
        "files": [entry for path in files for entry in _hashes(path)],
        "robot": spec.robot,
        "map": log_map.model_dump(exclude_defaults=True),
        "resampling": {
            "rate": spec.rate,
            "hold": [c.name for c in spec.channels if c.hold and c.name in {k.name for k in channels}],
            "starts": {name: p.start for name, p in zip(names, placed, strict=True)},
        },
        "clocks": {name: p.span.begin for name, p in zip(names, placed, strict=True)},
        "findings": [vars(f) for f in (*findings, *order.findings)],
    }
    return Recording(
        channels,
        tuple(Episode(name, time, values[:, present], settings) for name, time, values, settings in kept),
        measured=True,
        provenance=provenance,
    )


def _refuse(files: Sequence[Path], episodes: Sequence[RawEpisode], findings: Sequence[Finding]) -> None:
    """Raises CheckError for a log that a check refuses, LogError for one that holds no episode."""
    blocking = errors(findings)
    if blocking:
        more = f" (and {len(blocking) - 1} more)" if len(blocking) > 1 else ""
        raise CheckError(
            f"{blocking[0].where}: {blocking[0].told}{more}",
            expected="a log that passes the checks",
            do="run `dynreg doctor` on it to see everything that was found",
        )
    if not episodes:
        raise LogError(
            f"{files[0].name!r} holds no episode of two samples",
            expected="at least one",
            do="correct [episodes] in the map",
        )


@dataclass(frozen=True)
class _Placed:
    """An episode at the robot's control rate.

    start : [s] its begin on the log's clock. time : (T,) [s] from 0. values : (T, C).
    """

    raw: RawEpisode
    start: float
    time: np.ndarray
    values: np.ndarray

    @property
    def span(self) -> Span:
        """Where it lies on the clock that the log keeps."""
        begin = self.raw.clock + self.start
        return Span(begin, begin + float(self.time[-1]), self.raw.log, self.raw.file)


def _names(episodes: Sequence[RawEpisode]) -> list[str]:
    """The names of the episodes, as text, which a file's name need not be; the second of a name gets "#2"."""
    seen: Counter[str] = Counter()
    names = []
    for name in (visible(episode.name) for episode in episodes):
        seen[name] += 1
        names.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return names


@_overflowing
def doctor(
    paths: Paths, spec: RecordingSpec | None = None, log_map: LogMap | None = None
) -> tuple[Finding, ...]:
    """Every check on one or several logs, without ingesting them.

    With a robot's `spec` also its channels, units and limits. What cannot be read or mapped at all is an
    error finding too, so this raises nothing for a bad log.
    """
    files = _expand(paths)
    if spec is not None:
        try:
            episodes, findings, _ = _mapped(files, spec, log_map)
        except DynregError as error:
            return (_unread(error, files),)
        spans = []
        for episode in episodes if not errors(findings) else ():
            try:
                spans.append(_Placed(episode, *resample(episode, spec)).span)
                findings += check_span(episode, spec)
            except LogError as error:
                findings.append(_finding(error, "span", f"{episode.file}, episode {episode.name}"))
        return (*findings, *order_of(spans))
    found, spans = [], []
    for number, path in enumerate(files):
        log, more = examine(path, log_map)
        found += more
        spans += spans_of(log, number) if log is not None else ()
    return (*found, *order_of(spans))


def spans_of(log: RawLog, number: int) -> list[Span]:
    """Where the runs of a log, which is the one of this number, lie on its clock before any robot is known."""
    parts = [(part.path.name, _stamps(part)) for part in episodes_of(log)]
    return [Span(float(at.min()), float(at.max()), number, name) for name, at in parts if len(at)]


def _stamps(log: RawLog) -> np.ndarray:
    """The first and last stamps of every signal of a log, on its clock [s]."""
    ends = [(np.min(s.time), np.max(s.time)) for s in log.sources.values() if len(s)]
    every = np.array(ends).ravel() + log.start
    return every[np.isfinite(every)]


def order_of(spans: Sequence[Span]) -> tuple[Finding, ...]:
    """What is to be said of the order of several logs, and of the rests between them; nothing of one log."""
    return laid(spans).findings if len({span.log for span in spans}) > 1 else ()


@_overflowing
def examine(path: str | Path, log_map: LogMap | None = None) -> tuple[RawLog | None, tuple[Finding, ...]]:
    """A log as it is, before any robot is known, and what the checks find; None where it cannot be read."""
    path = Path(path)
    try:
        log = read_log(path, _options(log_map)).stamped()
    except DynregError as error:
        return None, (_unread(error, [path]),)
    signals = signals_of(log)
    findings = [*log.findings, *shared(log, signals)]
    for part in episodes_of(log):
        told = {name: part.sources[name] for name in clocked(signals)}
        findings += check_clocks(told, part.path.name, _gap(log_map), counting=log.counting)
    for name in (signal.source for signal in signals):
        series = log.sources[name]
        findings += check_numbers(series, f"{path.name}, {name}")
        if log.metadata.get("episode_column") is None and steady(name):
            table = f"under the channel that has source = {json.dumps(name)}"
            findings += check_spikes(series, f"{path.name}, {name}", table)
    return log, (*findings, *_behaviour(log))


def _behaviour(log: RawLog) -> Iterator[Finding]:
    """What is to be said of the joints of a log, as far as their names tell which they are."""
    with suppress(DynregError):  # the log says too little, or contradicts itself; the other checks tell why
        drafted = as_logged(log)
        yield from check_behaviour(raw_episodes(log, drafted.log_map, drafted.spec), drafted.spec)


def _mapped(
    files: Sequence[Path], spec: RecordingSpec, log_map: LogMap | None
) -> tuple[list[RawEpisode], list[Finding], LogMap]:
    if log_map is not None:
        check_map(log_map, spec)
    episodes: list[RawEpisode] = []
    findings: list[Finding] = []
    maps: list[LogMap] = []
    for number, log in enumerate(_logs(files, log_map)):
        maps.append(log_map or identity_map(spec, log))
        findings += log.findings
        for episode in _episodes(log, maps[-1], spec, len(files) > 1):
            episodes.append(replace(episode, log=number))
            findings += check_episode(episode, spec, _gap(log_map))
    findings += check_lengths(episodes, spec)
    findings += check_behaviour(episodes, spec, findings)
    return episodes, findings, max(maps, key=lambda one: one.episodes.by == "column")


def _episodes(log: RawLog, log_map: LogMap, spec: RecordingSpec, several: bool) -> tuple[RawEpisode, ...]:
    """The episodes of one log, perhaps of several; LogError tells of stamps that are coarse before what they cause."""
    try:
        return raw_episodes(log, log_map, spec)
    except LogError as error:
        read = [log.sources[name] for name in log_map.sources if name in log.sources]
        if rounded := coarse(read):
            raise LogError(
                f"{log.path.name}: {rounded.said}", expected="stamps that tell rows apart", do=rounded.do
            ) from error
        if several and log.path.name not in error.problem:
            raise LogError(
                f"{log.path.name}: {error.problem}", expected=error.expected, do=error.do
            ) from error
        raise


def holds_sources(paths: Paths, spec: RecordingSpec, log_map: LogMap) -> bool:
    """Whether logs hold every signal that a map names, but for those of optional channels: it is a map of theirs.

    The clock that it names does not count.
    """
    free = {c.name for c in spec.channels if c.optional}
    named = {source for name, c in log_map.channels.items() if name not in free for source in c.sources}
    clockless = log_map.model_copy(update={"map": log_map.map.model_copy(update={"time": None})})
    try:
        return bool(named) and all(named <= log.sources.keys() for log in _logs(_expand(paths), clockless))
    except DynregError:
        return False


def _logs(files: Sequence[Path], log_map: LogMap | None) -> Iterable[RawLog]:
    options = _options(log_map)
    if log_map is None or not log_map.files:
        for path in files:
            yield read_log(path, options).stamped()
        return
    for stem, members in _groups(files, log_map.files).items():
        logs = {}
        for member, path in members.items():
            own = [s for s in options.sources if s.startswith(f"{member}.")]
            wanted = tuple(s.removeprefix(f"{member}.") for s in own)
            logs[member] = read_log(path, replace(options, sources=wanted)).stamped()
        first = next(iter(members.values()))
        yield side_by_side(first.with_name(stem or first.stem), logs)


def _groups(files: Sequence[Path], suffixes: Mapping[str, str]) -> dict[str, dict[str, Path]]:
    """Files of one episode by the part of their names before the suffix."""
    groups: dict[str, dict[str, Path]] = {}
    for path in files:
        member = next((m for m, suffix in suffixes.items() if path.name.endswith(suffix)), None)
        if member is None:
            raise LogError(
                f"{path.name!r} is none of the files that the map names",
                expected=f"a name that ends in {one_of(suffixes.values())}",
                do="leave it out, or correct [files] in the map",
            )
        groups.setdefault(path.name.removesuffix(suffixes[member]), {})[member] = path
    return groups


def _unread(error: DynregError, files: Sequence[Path]) -> Finding:
    """What is said of logs that cannot be read or mapped."""
    names = [path.name for path in files] or [""]
    where = next((name for name in names if error.problem.startswith(f"{name}:")), names[0])
    return _finding(error, "map" if isinstance(error, MapError) else "log", where)


def _finding(error: DynregError, check: str, where: str) -> Finding:
    return Finding("error", check, where, f"{error.problem}; expected {error.expected}", error.do)


def _options(log_map: LogMap | None) -> ReadOptions:
    return ReadOptions(log_map.map.time, log_map.map.time_unit, log_map.sources) if log_map else ReadOptions()


def _gap(log_map: LogMap | None) -> float:
    return log_map.episodes.gap if log_map else DEFAULT_GAP


def _expand(paths: Paths) -> list[Path]:
    files = [Path(paths)] if isinstance(paths, str | Path) else [Path(p) for p in paths]
    if not files:
        raise LogError("no log was given", expected="at least one path", do="pass the logs to read")
    seen: set[Path] = set()
    for path in files:
        if path.resolve() in seen:  # the same run would be fitted to and tested on
            raise LogError(f"log {str(path)!r} is given twice", expected="each log once", do="leave one out")
        seen.add(path.resolve())
    return files


def _hashes(path: Path) -> list[dict[str, Any]]:
    """Name and sha256 of a file, or of every file of a folder. Absolute paths would not travel."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    out = []
    for file in files:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        out.append({"name": visible(file.relative_to(path.parent).as_posix()), "sha256": digest})
    return out

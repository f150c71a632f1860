"""From log files to a Recording: read, map, check, resample, and write down what was done."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.checks import check_clocks, check_episode, check_numbers, errors
from dynreg.data.episodes import RawEpisode, raw_episodes
from dynreg.data.maps import DEFAULT_GAP, LogMap, check_map, identity_map
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.readers.merge import side_by_side
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.resample import resample
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import Finding, RawLog
from dynreg.errors import DynregError, LogError, MapError

__all__ = ["Finding", "RawLog", "doctor", "read_log", "read_recording"]

Paths = Sequence[str | Path] | str | Path


# A stranger's numbers may overflow what is computed of them; the checks then find them not finite, and say so.
_overflowing = np.errstate(over="ignore", invalid="ignore", divide="ignore")


@_overflowing
def read_recording(paths: Paths, spec: RecordingSpec, log_map: LogMap | None = None) -> Recording:
    """Ingest one or several logs as one measured Recording at the robot's control rate.

    Without a map the logs are tables whose columns have the names of the robot's channels (and `time`,
    perhaps `episode` and settings). Channels are in `spec` order; optional ones that no episode has are left
    out. Warnings, file hashes, the map and the resampling go to the provenance.

    Raises LogError for a log that cannot be read or that a check refuses, MapError for a map that does not
    fit the robot or the log.
    """
    files = _expand(paths)
    episodes, findings, log_map = _mapped(files, spec, log_map)
    blocking = errors(findings)
    if blocking:
        more = f" (and {len(blocking) - 1} more)" if len(blocking) > 1 else ""
        raise LogError(
            f"{blocking[0].where}: {blocking[0].message}{more}",
            expected="a log that passes the checks",
            do="run `dynreg doctor` on it to see everything that was found",
        )
    if not episodes:
        raise LogError(
            f"{files[0].name!r} holds no episode of two samples",
            expected="at least one",
            do="correct [episodes] in the map",
        )
    names = _names(episodes)
    starts, kept = {}, []
    for name, raw in zip(names, episodes, strict=True):
        starts[name], time, values = resample(raw, spec)
        kept.append((name, time, values, raw.settings))
    present = np.any([np.isfinite(values).any(axis=0) for _, _, values, _ in kept], axis=0)
    channels = tuple(
        Channel(c.name, c.unit) for c, there in zip(spec.channels, present, strict=True) if there
    )
    provenance = {
        "files": [entry for path in files for entry in _hashes(path)],
        "robot": spec.robot,
        "map": log_map.model_dump(exclude_defaults=True),
        "resampling": {
            "rate": spec.rate,
            "hold": [c.name for c in spec.channels if c.hold and c.name in {k.name for k in channels}],
            "starts": starts,
        },
        "findings": [vars(f) for f in findings],
    }
    return Recording(
        channels,
        tuple(Episode(name, time, values[:, present], settings) for name, time, values, settings in kept),
        measured=True,
        provenance=provenance,
    )


def _names(episodes: Sequence[RawEpisode]) -> list[str]:
    """The names of the episodes; the second of a name gets "#2"."""
    seen: Counter[str] = Counter()
    names = []
    for episode in episodes:
        seen[episode.name] += 1
        names.append(episode.name if seen[episode.name] == 1 else f"{episode.name}#{seen[episode.name]}")
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
            return (_finding(error, files),)
        for episode in episodes if not errors(findings) else ():
            try:
                resample(episode, spec)
            except LogError as error:
                where = f"{episode.file}, episode {episode.name}"
                findings.append(Finding("error", "span", where, str(error)))
        return tuple(findings)
    findings = []
    options = _options(log_map)
    for path in files:
        try:
            log = read_log(path, options)
        except DynregError as error:
            findings.append(_finding(error, [path]))
            continue
        findings += [*log.findings, *check_clocks(log.sources, path.name, _gap(log_map))]
        for name, series in log.sources.items():
            findings += check_numbers(series, f"{path.name}, {name}")
    return tuple(findings)


def _mapped(
    files: Sequence[Path], spec: RecordingSpec, log_map: LogMap | None
) -> tuple[list[RawEpisode], list[Finding], LogMap]:
    if log_map is not None:
        check_map(log_map, spec)
    episodes: list[RawEpisode] = []
    findings: list[Finding] = []
    for log in _logs(files, log_map):
        if log_map is None:
            log_map = identity_map(spec, log.sources, log.labels)
        findings += log.findings
        for episode in raw_episodes(log, log_map, spec):
            episodes.append(episode)
            findings += check_episode(episode, spec, _gap(log_map))
    return episodes, findings, log_map


def _logs(files: Sequence[Path], log_map: LogMap | None) -> Iterable[RawLog]:
    options = _options(log_map)
    if log_map is None or not log_map.files:
        for path in files:
            yield read_log(path, options)
        return
    for stem, members in _groups(files, log_map.files).items():
        logs = {}
        for member, path in members.items():
            own = [s for s in options.sources if s.startswith(f"{member}.")]
            wanted = tuple(s.removeprefix(f"{member}.") for s in own)
            logs[member] = read_log(path, replace(options, sources=wanted))
        yield side_by_side(next(iter(members.values())).with_name(stem), logs)


def _groups(files: Sequence[Path], suffixes: Mapping[str, str]) -> dict[str, dict[str, Path]]:
    """Files of one episode by the part of their names before the suffix."""
    groups: dict[str, dict[str, Path]] = {}
    for path in files:
        member = next((m for m, suffix in suffixes.items() if path.name.endswith(suffix)), None)
        if member is None:
            raise LogError(
                f"{path.name!r} is none of the files that the map names",
                expected=f"a name that ends in one of {list(suffixes.values())}",
                do="leave it out, or correct [files] in the map",
            )
        groups.setdefault(path.name.removesuffix(suffixes[member]), {})[member] = path
    return groups


def _finding(error: DynregError, files: Sequence[Path]) -> Finding:
    check = "map" if isinstance(error, MapError) else "log"
    return Finding("error", check, files[0].name if files else "", str(error))


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
        out.append({"name": file.relative_to(path.parent).as_posix(), "sha256": digest})
    return out

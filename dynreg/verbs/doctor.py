"""Checks of logs before they are ingested, their contents, and a map drafted from them."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from dynreg.data.clocks import Span
from dynreg.data.contents import contents
from dynreg.data.drafting import Draft, draft_map
from dynreg.data.ingest import Finding, doctor, examine, holds_sources, order_of, spans_of
from dynreg.data.maps import own_maps, read_map
from dynreg.errors import LogError
from dynreg.results.doctor import DraftedMap, LogContents, LogFinding, LogFindings
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.written import write_new


def findings(
    logs: Sequence[Path], robot: str | None, log_map: Path | None, draft: Path | None = None
) -> LogFindings:
    """What the checks find without a map; where logs cannot be used so, with the robot's own map, as ingesting does.

    draft : drafts a map from the first log that can be read, and writes it there ("-" writes no file); the logs are
    then checked with it. Without a robot the logs are checked as they are, and their contents are listed.
    Raises LogError where no log can be read to draft from, or `draft` is there already.
    """
    loaded = load_robot(robot) if robot else None
    spec = loaded.recording_spec if loaded else None
    if draft is not None and str(draft) != "-" and draft.exists():
        raise LogError(
            f"{str(draft)!r} is there already",
            expected="the name of a new file",
            do="name another, or remove it",
        )
    told, held, drafted = _looked(logs, loaded, draft) if spec is None or draft else ((), (), None)
    if drafted is not None:
        found = told if spec is None else (*doctor(logs, spec, drafted.log_map), *_taken(drafted))
    elif spec is None:
        found = told if log_map is None else doctor(logs, None, read_map(log_map))
    else:
        found = doctor(logs, spec, read_map(log_map) if log_map else None)
    if log_map is None and drafted is None and loaded is not None and not _usable(found):
        found = _by_own_map(logs, loaded, found)
    if spec is not None and _usable(found):
        found += tuple(f for log in logs for f in _saturated(log, found))
    return LogFindings(
        logs=tuple(map(str, logs)),
        robot=robot,
        usable=_usable(found),
        findings=tuple(LogFinding(**vars(f)) for f in found),
        contents=held,
        drafted=None if drafted is None else _written(drafted, draft),
    )


def _taken(drafted: Draft) -> Iterator[Finding]:
    """What is said where a drafted map says another unit of the clock than the log does."""
    counting = drafted.log.counting
    if counting is not None and counting.told == "steps":
        text = f'the drafted map says time_unit = "{counting.unit}", by the steps of {counting.column!r}'
        yield Finding("info", "clock", drafted.log.path.name, text, "check it")


def _by_own_map(logs: Sequence[Path], robot: Robot, found: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What is found by the first map of the robot with which the logs can be used; else by the first that is a map of
    theirs, where they cannot be read without one; else what was `found`.
    """
    told = None
    for path, own in own_maps(robot.folder):
        mine = doctor(logs, robot.recording_spec, own)
        if _usable(mine):
            return mine
        if told is None and (_read(mine) or holds_sources(logs, robot.recording_spec, own)):
            told = (*mine, Finding("info", "map", logs[0].name, f"read by the robot's map {path}"))
    return found if told is None or _read(found) else told


def _read(found: Sequence[Finding]) -> bool:
    """Whether logs could be read and mapped, whatever the checks then found."""
    return all(f.check not in ("log", "map") for f in found if f.severity == "error")


def _saturated(log: Path, found: Sequence[Finding]) -> tuple[Finding, ...]:
    """Efforts at their limit, in a log that holds efforts which the robot has no channels for."""
    if any(f.check == "saturation" for f in found):
        return ()
    return tuple(f for f in examine(log)[1] if f.check == "saturation")


def _looked(
    logs: Sequence[Path], robot: Robot | None, draft: Path | None
) -> tuple[tuple[Finding, ...], tuple[LogContents, ...], Draft | None]:
    """What is found in the logs as they are, what they hold, and the map drafted from the first that can be read."""
    found: list[Finding] = []
    held: list[LogContents] = []
    spans: list[Span] = []
    drafted = None
    for number, path in enumerate(logs):
        log, more = examine(path)
        found += more
        if log is not None:
            spans += spans_of(log, number)
            held += [LogContents(**asdict(topic)) for topic in contents(log)]
            if draft is not None and drafted is None:
                drafted = draft_map(log, robot.recording_spec if robot else None)
    if draft is not None and drafted is None:
        raise LogError(
            f"no map can be drafted: {found[0].told}", expected="a log that can be read", do="mend the log"
        )
    return (*found, *order_of(spans)), tuple(held), drafted


def _written(draft: Draft, path: Path | None) -> DraftedMap:
    if path is not None and str(path) != "-":
        write_new(path, draft.text.encode())
    return DraftedMap(
        text=draft.text,
        path=None if str(path) == "-" else str(path),
        found=tuple(draft.sources),
        missing=draft.missing,
        ambiguous=tuple(name for name, source in draft.sources.items() if source.ambiguous),
        settings=draft.settings,
    )


def _usable(found: Sequence[Finding]) -> bool:
    return all(f.severity != "error" for f in found)

"""Logs of a robot as a registered recording."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.registry import RecordingInfo, Registry
from dynreg.registry.recordings import check_name
from dynreg.results.stored import RecordingSummary
from dynreg.sim.robot import Robot
from dynreg.verbs.simulator import NAMES
from dynreg.verbs.subjects import found_in, of_effects, read_log, register


def ingest(
    registry: Registry,
    logs: str | Path | Sequence[str | Path] | Recording,
    robot: Robot,
    *,
    log_map: str | Path | None = None,
    name: str | None = None,
    gait: str | None = None,
    progress: Progress | None = None,
) -> RecordingSummary:
    """Read logs of a robot, check them and register them as one recording, under a name where one is given.

    The same numbers are the same recording, whichever robot they are ingested with: the last one is its usual robot.
    Each name keeps its own robot. A name moves to it from another recording of the same log files.
    log_map : as for `subjects.read_log`. gait : the stored gait that was played, by id or `@last`; its id goes into the
    recording's provenance. progress : is called with (stage, done, total).
    Raises LogError, MapError with what is wrong and where, NoMatchError and UsageError for a gait that is not there or
    another robot's; nothing is registered then.
    """
    registry.check_writable()
    require_name(name)
    recording = logs if isinstance(logs, Recording) else read_log(logs, robot, log_map, progress)
    report = progress or (lambda *_: None)
    report("store the recording", 0, 1)
    if gait is not None:
        from dynreg.verbs.gaits import trial_of

        recording = trial_of(registry, recording, gait, robot)
    before = _held(registry, recording.id, name)
    identity = register(registry, robot, recording, name)
    report("store the recording", 1, 1)
    notes = (*_changed(registry, identity, name, before), *_without_commands(recording, robot))
    version = registry.robot_info(robot.hash).version
    called = name or registry.recording_info(identity).name
    mine = [p.id for p in registry.populations() if p.robot_hash == robot.hash and not of_effects(p)]
    told = {"version": version, "simulators": sum(map(registry.count, mine)), "notes": notes}
    return recording_summary(identity, recording, robot.name, called).model_copy(update=told)


def require_name(name: str | None) -> None:
    """UsageError for what cannot be a recording's name, and for a word that means a simulator."""
    check_name(name)
    if name in NAMES:
        raise UsageError(
            f"{name!r} cannot be a recording's name: it means a simulator",
            expected=f"a name other than {', '.join(NAMES)}",
            do="give another --name",
        )


@dataclass(frozen=True)
class _Before:
    """The registry before: the recording that had the name, and the same recording."""

    holder: str | None
    recording: RecordingInfo | None


def _held(registry: Registry, recording: str, name: str | None) -> _Before:
    known = registry.recording_info(recording) if registry.holds(recording) else None
    return _Before(None if name is None else registry.name_holder(name), known)


def _changed(registry: Registry, identity: str, name: str | None, before: _Before) -> tuple[str, ...]:
    """Changes that ingesting made to stored things, a line each."""
    notes = []
    if before.holder not in (None, identity):
        owner = registry.robot_info(_robot(registry, before.holder))
        notes.append(
            f"the name {name!r} now means this recording. Recording {before.holder[:12]} of {owner}, from the same log "
            "files, had it before. It and its results are kept under its id"
        )
    if before.recording is not None:
        notes += _other_robot(registry, before.recording, registry.recording_info(identity), name or "")
    return tuple(notes)


def _other_robot(registry: Registry, before: RecordingInfo, after: RecordingInfo, name: str) -> Iterator[str]:
    """Which robot a recording, and a name of it, is used with now, where that is another than before."""
    last, own = (registry.robot_info(info.robot_hash) for info in (before, after))
    old, new = (registry.robot_info(info.robot_as(name)) for info in (before, after))
    if old == new:
        if last != own:
            yield f"the same numbers as before: the recording's id and @last now mean {own}, before {last}"
        return
    yield f"the same numbers as before: the recording is now used with {new}, before with {old}"
    kept = [
        f"{one!r} still means robot {registry.robot_info(robot).name!r}"
        for one, robot in zip(after.names, after.robots, strict=True)
        if robot != new.hash
    ]
    if kept:
        yield (
            f"{', '.join(kept)}. The recording's id and @last mean robot {new.name!r} from now on. For another robot, "
            "add --robot"
        )


def _without_commands(recording: Recording, robot: Robot) -> Iterator[str]:
    missing = [name for name in robot.actions if name not in recording.names]
    if missing:
        yield (
            f"the log has no commands ({missing[0]!r} is missing). The recording can be listed, shown and exported. It "
            "cannot be replayed, so query and diagnose cannot use it"
        )


def _robot(registry: Registry, recording: str) -> str:
    return registry.recording_info(recording).robot_hash


def recording_summary(identity: str, recording: Recording, robot: str, name: str) -> RecordingSummary:
    """The ingested recording, with the findings of the checks; those that are alike are one."""
    return RecordingSummary(
        recording=identity,
        name=name,
        robot=robot,
        measured=recording.measured,
        episodes=len(recording.episodes),
        rows_count=sum(len(e.time) for e in recording.episodes),
        duration=float(sum(e.duration for e in recording.episodes)),
        rate=recording.rate if recording.is_even else None,
        channels=recording.names,
        settings=tuple(sorted({k for e in recording.episodes for k in e.settings})),
        gait=recording.provenance.get("gait"),
        findings=tuple(f"{f.severity}: {f.where}: {f.told}" for f in found_in(recording)),
    )

"""The subjects of verbs: robots, logs, recordings and populations, found by name, id or path."""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import (
    AmbiguousError,
    Assumed,
    CheckError,
    DynregError,
    LogError,
    MapError,
    NoMatchError,
    RobotError,
    UsageError,
    command,
    one_of,
)
from dynreg.folder import expanded
from dynreg.registry import PopulationRecord, RecordingInfo, Registry, ResultRecord, RobotInfo
from dynreg.results.result import Result
from dynreg.results.stored import RecordingSummary

if TYPE_CHECKING:
    from dynreg.data.maps import LogMap
    from dynreg.data.recording import Recording
    from dynreg.data.series import Finding
    from dynreg.progress import Progress
    from dynreg.sim.robot import Robot


def loaded_robot(
    robot: "str | Path | Robot", ranges: str | None = None, registry: Registry | None = None
) -> "Robot":
    """A robot by its packaged name or folder, with one of its [populations] where `ranges` names it.

    registry : where a name that is neither is looked up, as the newest version of it, and hashes are. Raises RobotError
    where there is no such robot, UsageError for what can name none.
    """
    from dynreg.sim.robot import Robot, load_robot, with_population

    if isinstance(robot, Robot):
        return robot if ranges is None else with_population(robot, ranges)
    _require_word("robot", robot, "a robot's name, its folder, or a Robot")
    try:
        return load_robot(robot, ranges)
    except RobotError:
        kept = None if registry is None or exists(robot) else _kept_folder(registry, str(robot))
        if kept is None:
            raise
        return load_robot(kept, ranges)


def _require_word(what: str, value: object, expected: str) -> None:
    """Raise UsageError for what can be no name and no path."""
    if not isinstance(value, str | Path):
        raise UsageError(f"{what} {value!r}", expected=expected, do="give one")


def exists(path: str | Path) -> bool:
    """Whether something lies at a path; False for a word that can be none."""
    try:
        return expanded(path).exists()
    except (OSError, ValueError):
        return False


def _kept_folder(registry: Registry, ref: str) -> Path | None:
    """The registry's own copy of a robot that it has by this name or hash; None where it has none."""
    try:
        return registry.robot_folder(ref)
    except AmbiguousError:
        raise
    except NoMatchError:
        return None


def read_log(
    logs: str | Path | Sequence[str | Path],
    robot: "Robot",
    log_map: "str | Path | LogMap | None" = None,
    progress: "Progress | None" = None,
) -> "Recording":
    """Logs of a robot as one recording, with the map given, else by their own names or a packaged map.

    progress : is called with (stage, done, total). Raises LogError or MapError.
    """
    several = list(logs) if isinstance(logs, Iterable) and not isinstance(logs, str | bytes) else [logs]
    for one in several:
        _require_word("log", one, "a path, or several")
    paths = [Path(one) for one in several]
    stage = f"read and check {paths[0].name if len(paths) == 1 else f'{len(paths)} logs'}"
    report = progress or (lambda *_: None)
    report(stage, 0, 1)
    found = _read(paths, robot, log_map)
    report(stage, 1, 1)
    return found


def _read(paths: list[Path], robot: "Robot", log_map: "str | Path | LogMap | None") -> "Recording":
    from dynreg.data.ingest import holds_sources, read_recording
    from dynreg.data.maps import LogMap, own_maps, read_map

    spec = robot.recording_spec
    if log_map is not None:
        return read_recording(paths, spec, log_map if isinstance(log_map, LogMap) else read_map(log_map))
    try:
        return read_recording(paths, spec, None)
    except DynregError as unmapped:
        told = unmapped
        for path, own in own_maps(robot.folder):
            try:
                return read_recording(paths, spec, own)
            except CheckError as problem:  # it is its map: what a check says is what is wrong
                if not isinstance(told, CheckError):
                    by = f"{problem.problem} (read by the robot's map {path.name})"
                    told = CheckError(by, expected=problem.expected, do=problem.do)
            except (LogError, MapError) as problem:
                # it is the log's where that holds what it names, else it is the map of another log
                if told is unmapped and not isinstance(told, CheckError) and holds_sources(paths, spec, own):
                    told = _of_own_map(problem, path, robot)
        raise told from None


def _of_own_map(problem: DynregError, path: Path, robot: "Robot") -> DynregError:
    """What is wrong with a log or the map that its robot brings; nobody corrects one that comes with dynreg."""
    from dynreg.sim.robot import is_packaged

    if isinstance(problem, LogError) or not is_packaged(robot):
        by = f"{problem.problem} (the robot's map {path})"
        return type(problem)(by, expected=problem.expected, do=problem.do)
    return type(problem)(
        f"{problem.problem} (the map {path.name} that comes with {robot.name})",
        expected=problem.expected,
        do=f"draft a map of this log with `dynreg doctor LOG --robot {robot.name} --draft-map map.toml`, and pass it "
        "with --map",
    )


EFFECTS = "effects"  # the kind of a population whose entries carry one effect each


@dataclass(frozen=True)
class Recorded:
    """A recording that a verb is asked about: where it is kept, its robot, itself and its name.

    each : those that it was joined from; see `several.joined`.
    """

    registry: Registry
    robot: "Robot"
    recording: "Recording"
    name: str
    each: "tuple[Recorded, ...]" = ()

    def register(self) -> None:
        """Keep the robot and the recording where the registry does not yet."""
        for one in self.each:
            one.register()
        if not self.registry.holds(self.recording.id):
            register(self.registry, self.robot, self.recording, self._free_name() if self.each else None)
        elif self.robot.hash not in self.registry.robots():
            put_robot(self.registry, self.robot)

    def _free_name(self) -> str | None:
        """The name of what was joined; None, which is said, where a recording of other log files has it."""
        if self.registry.may_be_called(self.recording, self.name):
            return self.name
        holder = self.registry.name_holder(self.name) or ""
        warnings.warn(
            f"recording {holder[:12]} of other log files is called {self.name!r}: this one is kept without a name, as "
            f"{self.recording.id[:12]}",
            Assumed,
            2,
        )
        return None

    def keep(self, result: Result) -> None:
        """Store what a verb answers, with the recording that it is about."""
        self.register()
        self.registry.put_result(result.schema_name(), self.recording.id, result.to_dict())


def recorded(
    registry: Registry,
    reference: str | Path | RecordingSummary,
    robot: "str | Path | Robot | None" = None,
    log_map: "str | Path | LogMap | None" = None,
    *,
    ingest: bool,
) -> Recorded:
    """A recording by its id, name or `@last`, or read from a log of `robot`.

    robot : of a registered recording, any whose channels it has; by default the one that it was ingested with under
    this name, of an id or `@last` that with which it was ingested last.
    ingest : whether a log is registered at once; where not, `Recorded.register` does it when the verb has an answer.
    Raises NoMatchError for what is neither, UsageError for what can name neither and for a recording that lacks what
    the robot needs, LogError and MapError for a log that cannot be read.
    """
    if not isinstance(reference, RecordingSummary):
        _require_word("recording", reference, "its name or id, @last, or the path of a log")
    identity = _registered(registry, reference, robot)
    if identity is None:
        owner = loaded_robot(robot, registry=registry)
        loaded = read_log(reference, owner, log_map)
        _tell_found(loaded)
        if not ingest:
            return Recorded(registry, owner, loaded, _known_as(registry, loaded.id, owner.hash))
        identity = register(registry, owner, loaded)
    elif robot is None:
        owner = robot_of(registry, identity, reference)
    else:
        owner = loaded_robot(robot, registry=registry)
    info = registry.recording_info(identity)
    asked = Recorded(registry, owner, registry.recording(identity), called(info, reference, owner.hash))
    if robot is None:
        _tell_newer(asked)
    if owner.hash not in (info.robot_hash, *info.robots):
        require_fits(asked, owner)
    return asked


def every_recorded(
    registry: Registry,
    references: Sequence[str | Path | RecordingSummary],
    robot: "str | Path | Robot | None",
    log_map: "str | Path | LogMap | None",
    *,
    ingest: bool,
) -> list[Recorded]:
    """`recorded` for each of them. UsageError, too, for a map where all are stored already: none is read with it."""
    if log_map is not None:
        require_log(registry, references, robot, log_map)
    return [recorded(registry, one, robot, log_map, ingest=ingest) for one in references]


def require_log(
    registry: Registry,
    references: Sequence[str | Path | RecordingSummary],
    robot: "str | Path | Robot | None",
    log_map: "str | Path | LogMap",
) -> None:
    """UsageError for a map beside recordings that are all stored already; NoMatchError for what is no recording."""
    found = [_registered(registry, one, robot) for one in references]
    if None in found:
        return
    info = registry.recording_info(found[0])
    name = called(info, references[0], info.robot_hash)
    path = log_map if isinstance(log_map, str | Path) else "MAP"
    again = command("ingest", "LOG", "--robot", "ROBOT", "--map", path, "--name", "NAME")
    raise UsageError(
        f"log_map {str(path)!r} with recording {name!r}, which is stored already and not read again",
        expected="a map beside the path of a log",
        do=f"leave it out, or ingest the log again with this map under another name: `{again}`",
        setting="log_map",
    )


def _tell_found(recording: "Recording") -> None:
    """Warn of what the checks found in a log, as `ingest` tells it."""
    for one in found_in(recording):
        if one.severity == "warning":
            warnings.warn(f"{one.where}: {one.told}", Assumed, 3)


def found_in(recording: "Recording") -> "tuple[Finding, ...]":
    """What the checks found in the logs of a recording; what is alike is one."""
    from dynreg.data.series import Finding, once

    return once(Finding(**told) for told in recording.provenance.get("findings", ()))


def _known_as(registry: Registry, identity: str, robot_hash: str) -> str:
    """What the recording of a log is called, where these numbers are registered; else the beginning of its id."""
    known = registry.holds(identity)
    return registry.recording_info(identity).name_with(robot_hash) if known else identity[:12]


def called(info: RecordingInfo, reference: str | Path | RecordingSummary, robot_hash: str) -> str:
    """What a recording is called in an answer: as it was asked for, where that is a name of it."""
    word = reference.name if isinstance(reference, RecordingSummary) else str(reference)
    return word if word in info.names else info.name_with(robot_hash)


def lacking(recording: "Recording", robot: "Robot") -> list[str]:
    """What a robot cannot do without and a recording does not have: channels, their units, the rate of its rows.

    No setting is among it: `ingest` takes a log that lacks some, and its nominal value is used.
    """
    from dynreg.data.recording import SAME_RATE

    spec = robot.recording_spec
    units = {channel.name: channel.unit for channel in recording.channels}
    kinds = {"state": "channel", "action": "command", "input": "input", "enable": "input"}
    out = [f"{kinds[c.kind]} {c.name!r}" for c in spec.channels if not c.optional and c.name not in units]
    out += [
        f"channel {c.name!r} in {c.unit!r} (it is in {units[c.name]!r})"
        for c in spec.channels
        if units.get(c.name, c.unit) != c.unit
    ]
    rate = recording.rate
    if spec.rate is not None and rate is not None and abs(rate / spec.rate - 1) > SAME_RATE:
        out.append(f"rows at {spec.rate:g} Hz (it has {rate:.4g} Hz)")
    return out


def require_fits(asked: Recorded, robot: "Robot") -> None:
    """UsageError where a recording is `lacking` what a robot needs; settings that it does not tell are said."""
    needed, spec = lacking(asked.recording, robot), robot.recording_spec
    if needed:
        raise UsageError(
            f"recording {asked.name!r} lacks what robot {robot.name!r} ({robot.hash[:12]}) needs: "
            + ", ".join(needed),
            expected="a recording with all of these",
            do="ingest its log again with this robot, or name another robot",
        )
    told = [episode.settings.keys() for episode in asked.recording.episodes]
    untold = [n for n in spec.settings if n not in spec.usual and not all(n in names for names in told)]
    if untold:
        warnings.warn(
            f"recording {asked.name!r} does not tell {', '.join(untold)} in every episode: the nominal value of robot "
            f"{robot.name!r} ({robot.hash[:12]}) is used",
            Assumed,
            2,
        )


def _tell_newer(asked: Recorded) -> None:
    """Say that a robot has a newer version than the one that a recording was ingested with."""
    registry = asked.registry
    mine, last = (find(registry, asked.robot.hash) for find in (_version, _newest))
    if last.hash != mine.hash:
        warnings.warn(
            f"recording {asked.name!r} was ingested with version {mine.version} of robot {mine.name!r}, which is used. "
            f"Version {last.version} is newer: add --robot {word_for(registry, last)} to use it",
            Assumed,
            2,
        )


def _version(registry: Registry, robot_hash: str) -> RobotInfo:
    return next(info for info in registry.robot_versions() if info.hash == robot_hash)


def _newest(registry: Registry, robot_hash: str) -> RobotInfo:
    """The newest version of the robot that has this hash."""
    return registry.robot_versions(registry.robots()[robot_hash])[-1]


def word_for(registry: Registry, info: "RobotInfo | Robot") -> str:
    """A robot on the command line: its name where that means this one, else a prefix of its hash.

    It is registered, or will be with what is answered.
    """
    from dynreg.sim.robot import packaged_robots

    taken = info.name in packaged_robots() or exists(info.name)
    if taken:
        means = loaded_robot(info.name).hash if info.name in packaged_robots() else None
    else:
        known = registry.robot_versions(info.name)
        means = known[-1].hash if known else info.hash
    return info.name if means == info.hash else info.hash[:12]


def register(registry: Registry, robot: "Robot", recording: "Recording", name: str | None = None) -> str:
    """Keep a robot and a recording of it, under a name; its id. RobotError as `accept` raises it."""
    put_robot(registry, robot)
    return registry.put_recording(recording, robot.hash, name)


def put_robot(registry: Registry, robot: "Robot") -> None:
    """Keep a robot; RobotError as `accept` raises it."""
    from dynreg.verbs.accepted import accept

    accept(registry, robot)
    registry.put_robot(robot.files, robot.hash, robot.name)


def robot_of(
    registry: Registry, recording: str, reference: str | Path | RecordingSummary | ResultRecord = ""
) -> "Robot":
    """The robot of a registered recording (its id), from the registry's own copy.

    reference : what the recording was asked for by. Its names, what ingesting it answered, and results about it have
    robots of their own.
    """
    from dynreg.sim.robot import load_robot

    info = registry.recording_info(recording)
    if isinstance(reference, RecordingSummary):
        found = version_called(registry, info, reference.robot)
    elif isinstance(reference, ResultRecord):
        found = version_called(registry, info, reference.document.get("robot"))
    else:
        found = info.robot_as(str(reference))
    return load_robot(registry.robot_folder(found))


def version_called(registry: Registry, info: RecordingInfo, robot: str | None) -> str:
    """The hash of the robot of this name that a recording is used with; of the last one where it has none."""
    names = registry.robots()
    return next((h for h in (info.robot_hash, *info.robots) if names[h] == robot), info.robot_hash)


def of_effects(record: PopulationRecord) -> bool:
    """Whether the entries of a population carry one effect each, under the commands of one recording."""
    return record.spec.get("kind") == EFFECTS


def require_models(record: PopulationRecord) -> None:
    """UsageError for a population of effects, where one whose simulators have models is meant."""
    if of_effects(record):
        raise UsageError(
            f"population {record.id[:12]} has effects under the commands of one recording, and no models",
            expected="a population whose simulators have models",
            do="name another, ask `dynreg query` what the recording looks like, or take a simulator with its effect "
            "by `dynreg export ENTRY --as robot`",
        )


def named_effects(asked: Recorded, ref: str | None) -> PopulationRecord | None:
    """The population of effects that is meant: `ref`, or the only one under this recording where no other is there.

    None where a population of models is meant.
    """
    registry = asked.registry
    if ref is not None:
        record = registry.population(registry.resolve(ref, ("population",))[1])
        return record if of_effects(record) else None
    own = [r for r in registry.populations() if r.robot_hash == asked.robot.hash]
    like = [r for r in own if of_effects(r) and r.spec.get("like") == asked.recording.id]
    return like[0] if like and all(map(of_effects, own)) else None


def population_for(asked: Recorded, ref: str | None) -> tuple[str, int]:
    """Id and size of the population to ask about a recording: `ref`, or the only one of the robot that has models.

    One of another robot, or of another version of it, may be named where the recording has that robot's channels: its
    own robot simulates then. Raises UsageError where it has not or where there are several, NoMatchError where there is
    none or it has no entries.
    """
    registry = asked.registry
    if ref is None:
        record = _only_population(asked)
    else:
        record = registry.population(registry.resolve(ref, ("population",))[1])
        require_models(record)
        if record.robot_hash != asked.robot.hash:
            _tell_other(asked, record)
    count = registry.count(record.id)
    if count == 0:
        word = word_for(registry, _version(registry, record.robot_hash))
        seeded = ("--seed", record.seed) if record.seed else ()
        raise NoMatchError(
            f"population {record.id[:12]} has no entries yet",
            expected="at least one simulator",
            do=f"run `{command('populate', word, '-n', record.size, *seeded)}`",
        )
    return record.id, count


def _tell_other(asked: Recorded, record: PopulationRecord) -> None:
    """Say whose population is asked; UsageError where the recording does not fit its robot."""
    from dynreg.sim.robot import load_robot

    require_fits(asked, load_robot(asked.registry.robot_folder(record.robot_hash)))
    owner = _version(asked.registry, record.robot_hash)
    warnings.warn(f"population {record.id[:12]} is of {owner}: that one simulates", Assumed, 2)


def _only_population(asked: Recorded) -> PopulationRecord:
    """The only population of the robot that a recording is asked with."""
    robot, records = asked.robot, [r for r in asked.registry.populations() if not of_effects(r)]
    fitting = [r for r in records if r.robot_hash == robot.hash]
    if len(fitting) > 1:
        raise UsageError(
            f"{len(fitting)} populations of robot {robot.name!r}",
            expected=one_of(r.id[:12] for r in fitting),
            do="name one with --population",
        )
    if not fitting:
        raise _no_population(asked, [r for r in records if r.name == robot.name])
    return fitting[0]


def _no_population(asked: Recorded, older: Sequence[PopulationRecord]) -> NoMatchError:
    """The error for a robot that has no population; older : those of its other versions."""
    registry, robot = asked.registry, asked.robot
    versions = {info.hash: info for info in registry.robot_versions(robot.name)}
    mine = versions.get(robot.hash)
    what, size, instead = f"robot {robot.name!r} ({robot.hash[:12]})", 1000, ""
    if older and mine is not None:
        last = max(older, key=lambda r: versions[r.robot_hash].version)
        count = registry.count(last.id)
        what = f"{mine}; version {versions[last.robot_hash].version} has {count}"
        size, instead = last.size, f", or add --population {last.id[:12]} to use those"
    return NoMatchError(
        f"no simulators of {what}",
        expected=f"a population of the recording's robot in {str(registry.path)!r}",
        do=f"run `dynreg populate {word_for(registry, robot)} -n {size}`{instead}",
    )


def _registered(
    registry: Registry, recording: str | Path | RecordingSummary, robot: "str | Path | Robot | None"
) -> str | None:
    """The id of a registered recording; None for the path of a log of `robot`.

    Raises NoMatchError for what is neither, UsageError for a log whose robot is not named.
    """
    if isinstance(recording, RecordingSummary):
        return recording.recording
    try:
        identity = registry.resolve(str(recording), ("recording",))[1]
    except NoMatchError as unknown:
        if not exists(recording):
            path = robot is not None or bool(Path(recording).suffix)
            if not path or isinstance(unknown, AmbiguousError):
                raise
            raise NoMatchError(
                f"{unknown.problem}, and no log is there",
                expected=f"the path of a log, or {unknown.expected}",
                do=unknown.do,
            ) from None
        if robot is None:
            raise UsageError(
                f"{str(recording)!r} is a log, and no robot is named",
                expected="the robot that it was recorded on",
                do="add --robot ROBOT, or ingest it first",
            ) from None
        return None
    return identity

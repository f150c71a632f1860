"""What verbs are asked about: robots, logs, recordings and populations, found where they are said to be."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import DynregError, LogError, MapError, NoMatchError, UsageError
from dynreg.registry import PopulationRecord, Registry
from dynreg.results.result import Result
from dynreg.results.stored import RecordingSummary

if TYPE_CHECKING:
    from dynreg.data.maps import LogMap
    from dynreg.data.recording import Recording
    from dynreg.sim.robot import Robot


def loaded_robot(robot: "str | Path | Robot", ranges: str | None = None) -> "Robot":
    """A robot by its packaged name or folder, with one of its [populations] where `ranges` names it."""
    from dynreg.sim.robot import Robot, load_robot, with_population

    if isinstance(robot, Robot):
        return robot if ranges is None else with_population(robot, ranges)
    return load_robot(robot, ranges)


def read_log(
    logs: str | Path | Sequence[str | Path], robot: "Robot", log_map: "str | Path | LogMap | None" = None
) -> "Recording":
    """Logs of a robot as one recording, with the map given, else by their own names or a packaged map.

    Raises LogError or MapError.
    """
    from dynreg.data.ingest import read_recording
    from dynreg.data.maps import LogMap, read_map

    spec = robot.recording_spec
    paths = [Path(p) for p in ([logs] if isinstance(logs, str | Path) else logs)]
    if log_map is not None:
        return read_recording(paths, spec, log_map if isinstance(log_map, LogMap) else read_map(log_map))
    try:
        return read_recording(paths, spec, None)
    except DynregError as first:
        for path in sorted((robot.folder / "maps").glob("*.toml")):
            try:
                return read_recording(paths, spec, read_map(path))
            except (LogError, MapError):
                continue
        raise first from None


@dataclass(frozen=True)
class Recorded:
    """A recording that a verb is asked about: where it is kept, its robot, itself and its name."""

    registry: Registry
    robot: "Robot"
    recording: "Recording"
    name: str

    def register(self) -> None:
        """Keep the robot and the recording where the registry does not yet."""
        if not self.registry.holds(self.recording.id):
            register(self.registry, self.robot, self.recording)

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

    ingest : whether a log is registered at once; where not, `Recorded.register` does it when the verb has an answer.
    Raises NoMatchError for what is neither, UsageError for a recording of another robot, LogError and MapError for a
    log that cannot be read.
    """
    identity = _registered(registry, reference, robot)
    if identity is None:
        owner = loaded_robot(robot)
        loaded = read_log(reference, owner, log_map)
        if not ingest:
            return Recorded(registry, owner, loaded, loaded.id[:12])
        identity = register(registry, owner, loaded)
    name = registry.recording_info(identity).name
    return Recorded(registry, robot_of(registry, identity), registry.recording(identity), name)


def register(registry: Registry, robot: "Robot", recording: "Recording", name: str | None = None) -> str:
    """Keep a robot and a recording of it, under a name; its id."""
    registry.put_robot(robot.files, robot.hash, robot.name)
    return registry.put_recording(recording, robot.hash, name)


def robot_of(registry: Registry, recording: str) -> "Robot":
    """The robot of a registered recording (its id), from the registry's own copy."""
    from dynreg.sim.robot import load_robot

    return load_robot(registry.robot_folder(registry.recording_info(recording).robot_hash))


def population_for(registry: Registry, recording: str, ref: str | None) -> tuple[str, int]:
    """Id and size of the population to ask about a recording (its id): `ref`, or the only one of its robot.

    Raises UsageError for one of another robot or where there are several, NoMatchError where there is none or it has
    no entries.
    """
    info = registry.recording_info(recording)
    records = registry.populations()
    if ref is not None:
        identity = registry.resolve(ref, ("population",))[1]
        record = registry.population(identity)
    else:
        record = _only_population(registry, info.robot_hash, records)
    if record.robot_hash != info.robot_hash:
        raise UsageError(
            f"the recording is of robot {registry.robots()[info.robot_hash]!r}, "
            f"the population of {record.name!r}",
            expected="a population of the same robot folder",
            do="populate that robot, or ingest the log for this one",
        )
    count = registry.count(record.id)
    if count == 0:
        raise NoMatchError(
            f"population {record.id[:12]} has no entries yet",
            expected="at least one simulator",
            do=f"run `dynreg populate {record.name} -n {record.size}`",
        )
    return record.id, count


def _only_population(
    registry: Registry, robot_hash: str, records: Sequence[PopulationRecord]
) -> PopulationRecord:
    name = registry.robots()[robot_hash]
    fitting = [r for r in records if r.robot_hash == robot_hash]
    if not fitting:
        raise NoMatchError(
            f"no simulators of robot {name!r} (folder hash {robot_hash[:12]}) in {str(registry.path)!r}",
            expected="a population of the recording's robot",
            do=f"run `dynreg populate {name} -n 1000` first",
        )
    if len(fitting) > 1:
        raise UsageError(
            f"{len(fitting)} populations of robot {name!r}",
            expected=f"one of {[r.id[:12] for r in fitting]}",
            do="name one with --population",
        )
    return fitting[0]


def _registered(
    registry: Registry, recording: str | Path | RecordingSummary, robot: "str | Path | Robot | None"
) -> str | None:
    """The id of a registered recording; None for the path of a log of `robot`.

    Raises NoMatchError for what is neither, UsageError for a recording of another robot.
    """
    if isinstance(recording, RecordingSummary):
        return recording.recording
    try:
        identity = registry.resolve(str(recording), ("recording",))[1]
    except NoMatchError:
        if not Path(recording).exists():
            raise
        if robot is None:
            raise UsageError(
                f"{str(recording)!r} is a log, and no robot is named",
                expected="the robot that it was recorded on",
                do="add --robot ROBOT, or ingest it first",
            ) from None
        return None
    if robot is not None:
        owner = registry.robots()[registry.recording_info(identity).robot_hash]
        asked = loaded_robot(robot).name
        if owner != asked:
            raise UsageError(
                f"recording {str(recording)!r} is of robot {owner!r}, not of {asked!r}",
                expected=f"a recording of {asked!r}",
                do="leave --robot out, or name another recording",
            )
    return identity

"""One thing that a registry holds, with all that is known of it, and stored results."""

from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from dynreg.errors import CorruptError, DynregError, NoMatchError, one_of
from dynreg.registry import RecordingInfo, Registry, ResultRecord
from dynreg.results import RESULTS
from dynreg.results.result import Result
from dynreg.results.stored import EntrySummary
from dynreg.verbs.ingest import recording_summary
from dynreg.verbs.list import simulator_name
from dynreg.verbs.newest import newest_for
from dynreg.verbs.simulators import effects_of
from dynreg.verbs.subjects import of_effects, version_called

Shown = tuple[str, str, dict[str, Any]]  # name, robot, detail


def summary(registry: Registry, kind: str, identity: str, ref: str = "") -> EntrySummary:
    """One thing, with all that is known of it; ref : what it was asked for by, as a recording's names have robots."""
    told = (registry, identity, ref) if kind == "recording" else (registry, identity)
    name, robot, detail = _SHOWN[kind](*told)
    return EntrySummary(id=identity, kind=kind, name=name, robot=robot, detail=detail)


def _entry(registry: Registry, identity: str) -> Shown:
    entry = registry.load_entry(identity)
    record = registry.population(entry.population_id)
    if of_effects(record):
        told = {"effects": effects_of(record, entry) or "none"}
    else:
        told = {"own_loss": entry.own_loss, "train_loss": entry.train_loss}
    detail = {"population": record.id, "number": entry.number, **told, "parameters": entry.values}
    return f"{record.name}-{entry.number}", record.name, detail | entry.extra


def _recording(registry: Registry, identity: str, ref: str) -> Shown:
    info = registry.recording_info(identity)
    owner = info.robot_as(ref)
    robot, name = registry.robots()[owner], ref if ref in info.names else _name_with(info, owner)
    return (
        name,
        robot,
        {
            **recording_summary(identity, registry.recording(identity), robot, name).to_dict(),
            "version": registry.robot_info(owner).version,
            "also_called": [other for other in info.names if other != name],
        },
    )


def _name_with(info: RecordingInfo, owner: str) -> str:
    """The name that a recording got with a robot (its hash), "" where it got none."""
    name = info.name_with(owner)
    return name if name in info.names else ""


def _measured(registry: Registry, identity: str) -> Shown:
    entry = registry.measured(identity)
    detail = {
        "population": entry.population_id,
        "recording": entry.recording_id,
        "own_loss": entry.own_loss,
        "train_loss": entry.train_loss,
    }
    robot = registry.population(entry.population_id).name
    return registry.recording_info(entry.recording_id).name, robot, detail


def _population(registry: Registry, identity: str) -> Shown:
    record = registry.population(identity)
    detail = {"entries": registry.count(identity), "planned": record.size, "seed": record.seed}
    return record.name, record.name, detail | {"spec": dict(record.spec)}


def _simulator(registry: Registry, identity: str) -> Shown:
    config = registry.simulator(identity)
    ordered = in_order(config, _parameters(registry, config.get("robot")))
    return simulator_name(identity, config), config.get("robot_name", ""), ordered


def _result(registry: Registry, identity: str) -> Shown:
    record = registry.result(identity)
    return record.kind, record.document.get("robot", ""), _document(registry, record)


def _robot(registry: Registry, identity: str) -> Shown:
    name = registry.robots()[identity]
    info = registry.robot_info(identity)
    others = [other.version for other in registry.robot_versions(name) if other.hash != identity]
    return name, name, {"hash": identity, "version": info.version, "other_versions": others}


_SHOWN = {
    "entry": _entry,
    "measured": _measured,
    "recording": _recording,
    "population": _population,
    "simulator": _simulator,
    "result": _result,
    "robot": _robot,
}


def stored_result(registry: Registry, ref: str) -> Result:
    """A result by its id, or the newest about a recording; NoMatchError where there is none."""
    if ref == "@last":
        record = registry.latest()
    else:
        kind, identity = registry.resolve(ref, ("result", "recording"))
        record = registry.result(identity) if kind == "result" else _about(registry, identity, ref)
    if record.kind not in RESULTS:
        raise NoMatchError(
            f"result {ref!r} is of kind {record.kind!r}",
            expected=one_of(sorted(RESULTS)),
            do="name another",
        )
    try:
        return RESULTS[record.kind].model_validate(_document(registry, record))
    except ValidationError as problem:
        first = problem.errors()[0]
        raise CorruptError(
            f"result {record.id[:12]} does not read: {'.'.join(map(str, first['loc']))}: {first['msg']}",
            expected=f"a {record.kind} document of this version",
            do="run the command that made it again",
        ) from None


def _about(registry: Registry, recording: str, ref: str) -> ResultRecord:
    """The newest result about a recording; where its names have several robots, for the robot that `ref` asks it with.

    Where that robot has none, it is the newest of all.
    """
    info = registry.recording_info(recording)
    newest = registry.latest(None, recording)
    if len({info.robot_hash, *info.robots}) == 1:
        return newest
    return newest_for(registry, None, recording, registry.robots()[info.robot_as(ref)]) or newest


def in_order(document: Any, names: Sequence[str]) -> Any:
    """JSON data whose objects have these keys first and in this order: stored documents are sorted by the letter.

    >>> in_order({"answer": {"b": 1, "a": 2}}, ("b", "a"))
    {'answer': {'b': 1, 'a': 2}}
    """
    if isinstance(document, list):
        return [in_order(part, names) for part in document]
    if not isinstance(document, dict):
        return document
    keys = dict.fromkeys([name for name in names if name in document] + list(document))
    return {key: in_order(document[key], names) for key in keys}


def _document(registry: Registry, record: ResultRecord) -> dict[str, Any]:
    """A result's document with its parameters in the robot's own order."""
    if not registry.holds(record.recording_id):
        return record.document
    info = registry.recording_info(record.recording_id)
    owner = version_called(registry, info, record.document.get("robot"))
    return in_order(record.document, _parameters(registry, owner))


def _parameters(registry: Registry, robot_hash: str | None) -> tuple[str, ...]:
    """Names of a robot's parameters; none where its folder is lost, as what was stored can be read without it."""
    from dynreg.sim.robot import load_robot

    try:
        return load_robot(registry.robot_folder(robot_hash)).space.names if robot_hash else ()
    except DynregError:
        return ()

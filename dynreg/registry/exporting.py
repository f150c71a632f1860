"""A part of a registry as a registry of its own."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import dynreg.registry.disk as disk
from dynreg.errors import NoMatchError, UsageError
from dynreg.registry.entries import put_shard
from dynreg.registry.files import require_new, sweep_beside, temporary_folder
from dynreg.registry.loading import load_shards
from dynreg.registry.populations import held_spans
from dynreg.registry.recordings import check_name
from dynreg.registry.references import holds
from dynreg.registry.registry import Registry

INDEXES = ("graph", "embedding", "judged")
_NAMING = ("answer", "simulator", "calibrated_simulator", "extended_simulator")  # keys of results
_RESULTS = ("document",)  # likewise: a calibration's own gait


def export(registry: Registry, refs: Sequence[str], destination: Path | str) -> tuple[str, ...]:
    """Copy what `refs` name, with all it needs, to a new registry at `destination`; returns the ids.

    A population brings its robot, its arrays and all its entries; an entry brings the population's arrays and itself
    alone, a measured one its recording; a simulator brings its robot; a result brings its recording, the simulators
    and entries that it names as its answer and at its stages, and a gait of its own. Ids stay as they are.

    Raises
    ------
    UsageError : `destination` exists, its folder does not, or `refs` is empty.
    NoMatchError : a ref fits nothing, or several things.
    """
    destination = Path(destination)
    if not refs:
        raise UsageError(
            "an export of nothing", expected="at least one thing", do="name what to export; see `dynreg list`"
        )
    require_new(destination)
    wanted = [registry.resolve(ref) for ref in refs]
    sweep_beside(destination.absolute())
    with temporary_folder(destination.absolute()) as half_done:
        with Registry.open(half_done, create=True) as copy:
            for kind, identity in wanted:
                copy_thing(registry, copy, kind, identity)
        disk.rename(half_done, destination)
    disk.sync_folder(destination.absolute().parent)
    return tuple(identity for _, identity in wanted)


def copy_thing(registry: Registry, copy: Registry, kind: str, identity: str) -> None:
    """Copy one thing with all it needs to another registry; what is there already stays as it is.

    A population that is there gets the entries that it lacks.
    """
    if kind == "population" or not is_there(copy, kind, identity):
        _COPY[kind](registry, copy, identity)


def is_there(registry: Registry, kind: str, identity: str) -> bool:
    """Whether a registry holds the thing of this kind with this whole id."""
    with registry.directory.catalog.read() as connection:
        return holds(connection, kind, identity)


def copy_plan(registry: Registry, copy: Registry, population_id: str) -> None:
    """Copy a population with its robot and without its entries.

    One that is there grows by what there are entries of, not by what was only planned.
    """
    record = registry.population(population_id)
    copy_thing(registry, copy, "robot", record.robot_hash)
    if is_there(copy, "population", population_id):
        with registry.directory.catalog.read() as connection:
            stops = [stop for _, stop in held_spans(connection, population_id)]
        record = replace(record, size=min(record.size, max(stops, default=1)))
    copy.put_population(record)


def copy_indexes(registry: Registry, copy: Registry, population_id: str) -> None:
    """Copy the indexes of a population, where the copy has the same entries."""
    for key in INDEXES:  # they can be made again where others are there already
        arrays = registry.index(population_id, key)
        if arrays is not None:
            copy.put_index(population_id, key, arrays, registry.load(population_id, ()).ids)


def _copy_robot(registry: Registry, copy: Registry, robot_hash: str) -> None:
    info = registry.robot_info(robot_hash)
    copy.put_robot(registry.robot_folder(robot_hash), robot_hash, info.name, info.version)


def _copy_population(registry: Registry, copy: Registry, population_id: str) -> None:
    copy_plan(registry, copy, population_id)
    for start, data in load_shards(registry.directory, population_id):
        put_shard(copy.directory, population_id, start, data)
    copy_indexes(registry, copy, population_id)


def _copy_entry(registry: Registry, copy: Registry, entry_id: str) -> None:
    entry = registry.load_entry(entry_id)
    copy_plan(registry, copy, entry.population_id)
    copy.put_shard(entry.population_id, entry.number, entry.as_shard())


def _copy_recording(registry: Registry, copy: Registry, recording_id: str) -> None:
    info = registry.recording_info(recording_id)
    for name in info.names:
        check_name(name)  # before anything is put
    recording = registry.recording(recording_id)
    for robot_hash in dict.fromkeys((*info.robots, info.robot_hash)):
        copy_thing(registry, copy, "robot", robot_hash)
    for name in info.names[::-1]:  # the name that it got last comes last
        if copy.name_holder(name) in (None, recording_id):
            copy.put_recording(recording, info.robot_as(name), name)
    copy.put_recording(recording, info.robot_hash)


def _copy_measured(registry: Registry, copy: Registry, identity: str) -> None:
    entry = registry.measured(identity)
    copy_plan(registry, copy, entry.population_id)
    copy_thing(registry, copy, "recording", entry.recording_id)
    copy.put_measured(entry)


def _copy_simulator(registry: Registry, copy: Registry, simulator_id: str) -> None:
    config = registry.simulator(simulator_id)
    copy_thing(registry, copy, "robot", config["robot"])
    copy.put_simulator(config)


def _copy_result(registry: Registry, copy: Registry, result_id: str) -> None:
    result = registry.result(result_id)
    if result.recording_id:
        copy_thing(registry, copy, "recording", result.recording_id)
    needed = [(named, ("simulator", "entry")) for named in sorted(simulators_in(result.document))]
    needed += [(named, ("result",)) for named in sorted(_named(result.document, _RESULTS))]
    for named, kinds in needed:
        try:
            kind, identity = registry.resolve(named, kinds)
        except NoMatchError:
            continue  # lost before, or computed again as another: the result can be read without it
        copy_thing(registry, copy, kind, identity)
    copy.put_result(result.kind, result.recording_id or None, result.document)


def simulators_in(document: Any) -> set[str]:
    """The ids that a result's document gives as an `answer` or a simulator, at any depth."""
    return _named(document, _NAMING)


def _named(document: Any, keys: Sequence[str]) -> set[str]:
    """The words that a document gives under these keys, at any depth."""
    if isinstance(document, list):
        return set().union(*(_named(one, keys) for one in document))
    if not isinstance(document, dict):
        return set()
    mine = {value for value in map(document.get, keys) if isinstance(value, str)}
    return mine.union(*(_named(one, keys) for one in document.values()))


_COPY = {
    "robot": _copy_robot,
    "population": _copy_population,
    "entry": _copy_entry,
    "recording": _copy_recording,
    "measured": _copy_measured,
    "simulator": _copy_simulator,
    "result": _copy_result,
}

"""What a registry holds."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from operator import itemgetter
from typing import Any, TypeVar

from dynreg.errors import CorruptError, Damaged, UsageError, one_of
from dynreg.registry import Registry
from dynreg.results.stored import EntrySummary, Listing
from dynreg.verbs.simulator import made

KINDS = ("population", "recording", "measured", "simulator", "result", "robot")
Row = tuple[str, str, str, dict[str, Any]]  # id, name, robot, detail
Stored = TypeVar("Stored")
DAMAGED = "damaged"  # the name of what cannot be read
SHOWN = 8  # held-out episodes, or pieces of them, in a row of the list
# Of a result's document, what tells it from others of its kind.
TELLING = ("on", "method", "task", "verdict", "test_error")


def listing(registry: Registry, kind: str | None = None) -> Listing:
    """All populations, recordings, their entries, simulators, results and robots, or those of one kind.

    In this order of kinds; recordings and results of a kind as they came, the newest last, others by name. What cannot
    be read is listed as damaged, so that it can be removed; a warning tells why (`Damaged`).
    """
    if kind is not None and kind not in KINDS:
        raise UsageError(f"kind {kind!r}", expected=one_of(KINDS), do="choose one of them")
    items = [
        EntrySummary(id=identity, kind=k, name=name, robot=robot, detail=detail)
        for k in (KINDS if kind is None else (kind,))
        for identity, name, robot, detail in _ROWS[k](registry)
    ]
    return Listing(registry=str(registry.path), items=tuple(items))


def simulator_name(identity: str, config: Mapping[str, Any]) -> str:
    """Robot, how the simulator came about and the beginning of its id: simulators have no other name.

    >>> simulator_name("ab12" * 16, {"robot_name": "leg", "lineage": {"made_by": "query", "kind": "synthesised"}})
    'leg synthesised ab12ab12'
    """
    parts = (config.get("robot_name"), made(config.get("lineage", {})), identity[:8])
    return " ".join(part for part in parts if part)


def _populations(registry: Registry) -> Iterator[Row]:
    versions = _versions(registry)
    for r in registry.populations():
        detail = {"entries": registry.count(r.id), "planned": r.size, "seed": r.seed}
        detail["version"] = versions[r.robot_hash]
        yield r.id, r.name, r.name, detail


def _recordings(registry: Registry) -> Iterator[Row]:
    robots = {info.hash: info for info in registry.robot_versions()}
    for i in registry.recordings():
        robot = robots[i.robot_hash]
        names = [
            name if owner == i.robot_hash else f"{name} (of {robots[owner].name})"
            for name, owner in zip(i.names, i.robots, strict=True)
        ]
        yield i.id, ", ".join(names), robot.name, {"version": robot.version}


def _measured(registry: Registry) -> Iterator[Row]:
    """The entries of recordings: the models that were trained on them."""
    for r in registry.populations():
        entries = registry.measured_in(r.id)
        names = {entry: registry.recording_info(recording).name for recording, entry in entries.items()}
        for entry, name in sorted(names.items(), key=itemgetter(1, 0)):
            yield entry, name, r.name, {"population": r.id[:12]}


def _simulators(registry: Registry) -> Iterator[Row]:
    configs = _read(registry, "simulator", registry.simulator)
    rows = [
        (i, DAMAGED, "", {}) if c is None else (i, simulator_name(i, c), c.get("robot_name", ""), {})
        for i, c in configs
    ]
    # a name begins with the robot's and tells how it was made
    yield from sorted(rows, key=itemgetter(1, 0))


def _results(registry: Registry) -> Iterator[Row]:
    for identity, record in _read(registry, "result", registry.result):
        if record is None:
            yield identity, DAMAGED, "", {}
            continue
        detail = {"recording": _name_of(registry, record.recording_id)} if record.recording_id else {}
        detail |= {name: record.document[name] for name in TELLING if record.document.get(name) is not None}
        detail |= _tested(record.document) | _score(record.document)
        yield record.id, record.kind, record.document.get("robot", ""), detail


def _read(
    registry: Registry, kind: str, read: Callable[[str], Stored]
) -> Iterator[tuple[str, Stored | None]]:
    """The things of a kind by id; None for one that is damaged, of which a warning tells (`Damaged`)."""
    for identity in registry.ids(kind):
        try:
            yield identity, read(identity)
        except CorruptError as error:
            warnings.warn(f"{kind} {identity[:12]} cannot be read: {error.problem}", Damaged, 2)
            yield identity, None


def _name_of(registry: Registry, recording: str) -> str:
    """What a recording is called; the beginning of its id where it is gone."""
    return registry.recording_info(recording).name if registry.holds(recording) else recording[:12]


def _tested(document: Mapping[str, Any]) -> dict[str, Any]:
    """Of a calibration with a test error what was held out for it, and what of that it saw; else nothing.

    Errors can be compared where the same was held out.
    """
    if document.get("test_error") is None or not (held := (document.get("parts") or {}).get("test")):
        return {}
    more = f" and {len(held) - SHOWN} more" if len(held) > SHOWN else ""
    told = ", ".join(held[:SHOWN]) + more
    seen = document.get("seen")
    return {"held_out": told, **({"saw": ", ".join(seen)} if seen else {})}


def _score(document: Mapping[str, Any]) -> dict[str, Any]:
    """Of a gait what a trial is expected to score; of a calibration that tried the robot task, trials, falls, and the
    best score; else nothing."""
    if (expected := document.get("expected")) and document.get("schema", "").startswith("dynreg/gait/"):
        return {"expected_score": round(expected["median"], 4)}
    told = document.get("on_robot")
    if not told:
        return {}
    best = told["tried"][told["best"] - 1]["scores"]
    spent = {name: document["cost"][name] for name in ("trials", "falls")}
    return {"task": told["task"], **spent, "score": round(sum(best) / len(best), 4)}


def _robots(registry: Registry) -> Iterator[Row]:
    """The versions of each robot in the order in which they came, with what hangs on each."""
    populations, recordings = registry.populations(), registry.recordings()
    for info in registry.robot_versions():
        mine = [r.id for r in populations if r.robot_hash == info.hash]
        detail = {"version": info.version, "populations": len(mine)}
        detail |= {"entries": sum(map(registry.count, mine))}
        detail |= {"recordings": sum(info.hash in (r.robot_hash, *r.robots) for r in recordings)}
        yield info.hash, info.name, info.name, detail


def _versions(registry: Registry) -> dict[str, int]:
    return {info.hash: info.version for info in registry.robot_versions()}


_ROWS = {
    "population": _populations,
    "recording": _recordings,
    "measured": _measured,
    "simulator": _simulators,
    "result": _results,
    "robot": _robots,
}

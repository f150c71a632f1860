"""Summaries of what a registry holds, as results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from dynreg import results
from dynreg.data.recording import Recording
from dynreg.errors import CorruptError, DynregError, NoMatchError, UsageError
from dynreg.registry import Registry, ResultRecord, verify

KINDS = ("population", "recording", "simulator", "result", "robot")
_RESULTS = {
    "neighbours": results.Neighbours,
    "calibration": results.Calibration,
    "diagnosis": results.Diagnosis,
    "trials": results.TrialTable,
    "gait": results.Gait,
    "drift": results.Drift,
    "comparison": results.Comparison,
}


def recording_summary(identity: str, recording: Recording, robot: str, name: str) -> results.RecordingSummary:
    """What was ingested, with the findings of the checks."""
    gaps = [np.diff(e.time) for e in recording.episodes if len(e.time) > 1]
    findings = recording.provenance.get("findings", [])
    return results.RecordingSummary(
        recording=identity,
        name=name,
        robot=robot,
        measured=recording.measured,
        episodes=len(recording.episodes),
        rows_count=sum(len(e.time) for e in recording.episodes),
        duration=float(sum(e.duration for e in recording.episodes)),
        rate=float(1.0 / np.median(np.concatenate(gaps))) if gaps else None,
        channels=recording.names,
        settings=tuple(sorted({k for e in recording.episodes for k in e.settings})),
        gait=recording.provenance.get("gait"),
        findings=tuple(f"{f['severity']}: {f['where']}: {f['message']}" for f in findings),
    )


def listing(registry: Registry, kind: str | None) -> results.Listing:
    """All populations, recordings, simulators, results and robots, or those of one kind."""
    if kind is not None and kind not in KINDS:
        raise UsageError(f"kind {kind!r}", expected=f"one of {list(KINDS)}", do="choose one of them")
    wanted = KINDS if kind is None else (kind,)
    items = [item for k in wanted for item in _LISTED[k](registry)]
    return results.Listing(registry=str(registry.path), items=tuple(items))


def summary(registry: Registry, kind: str, identity: str) -> results.EntrySummary:
    """One thing, with all that is known of it."""
    if kind == "entry":
        return _entry(registry, identity)
    if kind == "recording":
        info = next(i for i in registry.recordings() if i.id == identity)
        robot = registry.robots()[info.robot_hash]
        told = recording_summary(
            identity, registry.recording(identity), robot, info.names[0] if info.names else ""
        )
        return _item(identity, "recording", told.name, robot, told.to_dict())
    if kind == "population":
        record = registry.population(identity)
        return _item(
            identity,
            "population",
            record.name,
            record.name,
            _population_detail(registry, record) | {"spec": dict(record.spec)},
        )
    if kind == "simulator":
        config = registry.simulator(identity)
        ordered = in_order(config, _parameters(registry, config.get("robot")))
        return _item(
            identity, "simulator", simulator_name(identity, config), config.get("robot_name", ""), ordered
        )
    if kind == "result":
        record = registry.result(identity)
        return _item(
            identity, "result", record.kind, record.document.get("robot", ""), _document(registry, record)
        )
    return _item(
        identity, "robot", registry.robots()[identity], registry.robots()[identity], {"hash": identity}
    )


def _entry(registry: Registry, identity: str) -> results.EntrySummary:
    entry = registry.load_entry(identity)
    record = registry.population(entry.population_id)
    detail = {
        "population": entry.population_id,
        "number": entry.number,
        "own_loss": entry.own_loss,
        "train_loss": entry.train_loss,
        "parameters": entry.values,
        **entry.extra,
    }
    return _item(identity, "entry", f"{record.name}-{entry.number}", record.name, detail)


def stored_result(registry: Registry, ref: str) -> results.Result:
    """A result by its id, or the newest about a recording; NoMatchError where there is none."""
    if ref == "@last":
        record = registry.latest()
    else:
        kind, identity = registry.resolve(ref, ("result", "recording"))
        record = registry.result(identity) if kind == "result" else registry.latest(None, identity)
    if record.kind not in _RESULTS:
        raise NoMatchError(
            f"result {ref!r} is of kind {record.kind!r}",
            expected=f"one of {sorted(_RESULTS)}",
            do="name another",
        )
    try:
        return _RESULTS[record.kind].model_validate(_document(registry, record))
    except ValidationError as problem:
        first = problem.errors()[0]
        raise CorruptError(
            f"result {record.id[:12]} does not read: {'.'.join(map(str, first['loc']))}: {first['msg']}",
            expected=f"a {record.kind} document of this version",
            do="run the command that made it again",
        ) from None


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


def simulator_name(identity: str, config: Mapping[str, Any]) -> str:
    """Robot, how the simulator came about and the beginning of its id: simulators have no other name.

    >>> simulator_name("ab12" * 16, {"robot_name": "leg", "lineage": {"made_by": "query", "kind": "synthesised"}})
    'leg synthesised ab12ab12'
    """
    lineage = config.get("lineage", {})
    made = lineage.get("kind") or lineage.get("made_by", "").replace("calibrate", "calibrated by")
    return " ".join(part for part in (config.get("robot_name"), made, identity[:8]) if part)


def verification(path: Path, repair: bool) -> results.Verification:
    """`verify` of the registry at `path`, as a result."""
    report = verify(path, repair)
    return results.Verification(
        registry=str(path),
        clean=not report.faults,
        checked=dict(report.checked),
        faults=tuple(str(fault) for fault in report.faults),
        repaired=tuple(str(f) for f in report.faults if getattr(f, "mended", None)),
        lost=tuple(str(f) for f in report.lost),
    )


def information(registry: Registry) -> dict[str, Any]:
    """Versions, device, cores, and counts of what the registry holds."""
    import os
    from importlib.metadata import version

    listed = listing(registry, None)
    counts = {kind: sum(i.kind == kind for i in listed.items) for kind in KINDS}
    packages = {name: version(name) for name in ("dynreg", "mujoco", "torch", "numpy", "pyarrow")}
    return {
        "schema": "dynreg/info/1",
        "registry": str(registry.path),
        "holds": counts,
        "entries": sum(registry.count(p.id) for p in registry.populations()),
        "versions": packages,
        "device": _device(),
        "cores": os.cpu_count(),
    }


def _device() -> str:
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"


def _populations(registry: Registry) -> list[results.EntrySummary]:
    return [
        _item(r.id, "population", r.name, r.name, _population_detail(registry, r))
        for r in registry.populations()
    ]


def _recordings(registry: Registry) -> list[results.EntrySummary]:
    names = registry.robots()
    return [
        _item(i.id, "recording", ", ".join(i.names), names[i.robot_hash], {}) for i in registry.recordings()
    ]


def _simulators(registry: Registry) -> list[results.EntrySummary]:
    ids = registry.ids("simulator")
    configs = [(i, registry.simulator(i)) for i in ids]
    return [_item(i, "simulator", simulator_name(i, c), c.get("robot_name", ""), {}) for i, c in configs]


def _results(registry: Registry) -> list[results.EntrySummary]:
    records = [registry.result(i) for i in registry.ids("result")]
    return [
        _item(
            r.id,
            "result",
            r.kind,
            r.document.get("robot", ""),
            {"recording": r.recording_id[:12]} if r.recording_id else {},
        )
        for r in records
    ]


def _robots(registry: Registry) -> list[results.EntrySummary]:
    return [_item(h, "robot", name, name, {}) for h, name in registry.robots().items()]


_LISTED = {
    "population": _populations,
    "recording": _recordings,
    "simulator": _simulators,
    "result": _results,
    "robot": _robots,
}


def _document(registry: Registry, record: ResultRecord) -> dict[str, Any]:
    """A result's document with its parameters in the robot's own order."""
    robots = [info.robot_hash for info in registry.recordings() if info.id == record.recording_id]
    return in_order(record.document, _parameters(registry, robots[0] if robots else None))


def _parameters(registry: Registry, robot_hash: str | None) -> tuple[str, ...]:
    """Names of a robot's parameters; none where its folder is lost, as what was stored can be read without it."""
    from dynreg.sim.robot import load_robot

    try:
        return load_robot(registry.robot_folder(robot_hash)).space.names if robot_hash else ()
    except DynregError:
        return ()


def _population_detail(registry: Registry, record) -> dict[str, Any]:
    return {"entries": registry.count(record.id), "planned": record.size, "seed": record.seed}


def _item(identity: str, kind: str, name: str, robot: str, detail: dict[str, Any]) -> results.EntrySummary:
    return results.EntrySummary(id=identity, kind=kind, name=name, robot=robot, detail=detail)

"""Simulators of a registry that are compared: by their ids, by those of results, or the robot's nominal one."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dynreg.errors import NoMatchError
from dynreg.registry import Registry, ResultRecord
from dynreg.results.comparison import Contender
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot, load_robot

NOMINAL = "nominal"
NEWEST = {"diagnosis": "diagnosis", "query": "neighbours", "calibration": "calibration"}  # about a recording
ANSWERS = {  # where a stored result tells the simulator that it recommends
    "diagnosis": ("extended_simulator", "calibrated_simulator"),
    "neighbours": ("answer",),
    "calibration": ("simulator",),
}


@dataclass(frozen=True)
class Simulator:
    """A simulator by the name that it has in a comparison; its configuration and its robot.

    fitted_to : episodes of the recording to which it was fitted, or by which it was chosen, whole or in part; empty
    where nothing says that it was, None where it was and nothing says to which.
    """

    shown: Contender
    config: SimConfig
    robot: Robot
    fitted_to: frozenset[str] | None = frozenset()


def simulators(
    registry: Registry, robot: Robot, refs: Sequence[str], recording: str
) -> tuple[Simulator, ...]:
    """Each once, however often it is named, and each with a name of its own; see `simulator`."""
    found = {one.config.id: one for one in (simulator(registry, robot, ref, recording) for ref in refs)}
    names = [one.shown.name for one in found.values()]
    return tuple(
        one
        if names.count(one.shown.name) == 1
        else replace(one, shown=one.shown.model_copy(update={"name": f"{one.shown.name} {identity[:8]}"}))
        for identity, one in found.items()
    )


def simulator(registry: Registry, robot: Robot, ref: str, recording: str) -> Simulator:
    """A registered simulator or entry, the one that a stored result recommends, or `nominal` of the robot.

    "diagnosis", "query" and "calibration" are the newest results about the recording (its id). These four words hide
    nothing: simulators, entries and results have ids and no names. Raises NoMatchError where there is none.
    """
    if ref == NOMINAL:
        config = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))
        return Simulator(_shown(NOMINAL, "nominal simulator", None, config), config, robot)
    if ref in NEWEST:
        kind, identity = "result", registry.latest(NEWEST[ref], recording).id
    else:
        kind, identity = registry.resolve(ref, ("simulator", "entry", "result"))
    if kind == "result":
        record = registry.result(identity)
        found = simulator(registry, robot, _answer(ref, record), recording)
        if record.recording_id != recording:
            return found
        return replace(found, fitted_to=_fitted(record.document))
    if kind == "entry":
        entry = registry.load_entry(identity)
        record = registry.population(entry.population_id)
        config = SimConfig(record.robot_hash, record.name, entry.values)
        name, how, made_here = f"{record.name}-{entry.number}", "simulator of a population", False
    else:
        document = registry.simulator(identity)
        config = SimConfig.from_dict(document)
        lineage = document.get("lineage", {})
        made = lineage.get("kind") or lineage.get("made_by") or "simulator"
        made = made.replace("calibrate ", "calibrated by ")
        name, how = f"{made} {identity[:8]}", " ".join(filter(None, (made, "simulator")))
        made_here = lineage.get("recording") == recording
    fitted_to = _by_newest(registry, identity, recording)
    if fitted_to is not None and not fitted_to and made_here:
        fitted_to = None
    owner = robot if config.robot == robot.hash else load_robot(registry.robot_folder(config.robot))
    return Simulator(_shown(name, how, identity, config), config, owner, fitted_to)


def _shown(name: str, kind: str, identity: str | None, config: SimConfig) -> Contender:
    effects = {key: dict(values) for key, values in config.effects.items()}
    return Contender(
        name=name, kind=kind, simulator=identity, parameters=dict(config.values), effects=effects
    )


def _fitted(document: Mapping[str, Any]) -> frozenset[str] | None:
    """Names of the episodes that a result's simulator was fitted to or chosen by; None where it does not say.

    Parts are told by episode, or as "episode[3]" where an episode was cut into windows.
    """
    parts = document.get("parts")
    if parts is None:
        return None
    chosen = (*parts["fit"], *parts["select"])
    return frozenset(re.sub(r"\[\d+\]$", "", name) for name in chosen)


def _by_newest(registry: Registry, identity: str, recording: str) -> frozenset[str] | None:
    """What the newest results about a recording say of a simulator that they recommend; nothing where they do not."""
    for kind, keys in ANSWERS.items():
        try:
            document = registry.latest(kind, recording).document
        except NoMatchError:
            continue
        if identity in (document.get(key) for key in keys):
            return _fitted(document)
    return frozenset()


def _answer(ref: str, record: ResultRecord) -> str:
    told = (record.document.get(key) for key in ANSWERS.get(record.kind, ()))
    found = next(filter(None, told), None)
    if found is None:
        raise NoMatchError(
            f"result {ref!r} is of kind {record.kind!r} and recommends no simulator",
            expected="a diagnosis, a query or a calibration that left one",
            do="name a simulator; see `dynreg list --kind simulator`",
        )
    return found

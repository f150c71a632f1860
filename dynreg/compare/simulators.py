"""Simulators of a registry that are compared: by their ids, by those of results, or the robot's nominal one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynreg.errors import NoMatchError
from dynreg.registry import Registry
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
    """A simulator by the name that it has in a comparison; its configuration and its robot."""

    shown: Contender
    config: SimConfig
    robot: Robot


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

    "diagnosis", "query" and "calibration" are the newest results about the recording (its id). Raises NoMatchError
    where there is none.
    """
    if ref == NOMINAL:
        config = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))
        return Simulator(_shown(NOMINAL, "nominal simulator", None, config), config, robot)
    if ref in NEWEST:
        kind, identity = "result", registry.latest(NEWEST[ref], recording).id
    else:
        kind, identity = registry.resolve(ref, ("simulator", "entry", "result"))
    if kind == "result":
        return simulator(registry, robot, _answer(registry, ref, identity), recording)
    if kind == "entry":
        entry = registry.load_entry(identity)
        record = registry.population(entry.population_id)
        config = SimConfig(record.robot_hash, record.name, entry.values)
        name, how = f"{record.name}-{entry.number}", "simulator of a population"
    else:
        document = registry.simulator(identity)
        config = SimConfig.from_dict(document)
        lineage = document.get("lineage", {})
        made = lineage.get("kind") or lineage.get("made_by") or "simulator"
        made = made.replace("calibrate ", "calibrated by ")
        name, how = f"{made} {identity[:8]}", " ".join(filter(None, (made, "simulator")))
    owner = robot if config.robot == robot.hash else load_robot(registry.robot_folder(config.robot))
    return Simulator(_shown(name, how, identity, config), config, owner)


def _shown(name: str, kind: str, identity: str | None, config: SimConfig) -> Contender:
    effects = {key: dict(values) for key, values in config.effects.items()}
    return Contender(
        name=name, kind=kind, simulator=identity, parameters=dict(config.values), effects=effects
    )


def _answer(registry: Registry, ref: str, identity: str) -> str:
    record = registry.result(identity)
    told = (record.document.get(key) for key in ANSWERS.get(record.kind, ()))
    found = next(filter(None, told), None)
    if found is None:
        raise NoMatchError(
            f"result {ref!r} is of kind {record.kind!r} and recommends no simulator",
            expected="a diagnosis, a query or a calibration that left one",
            do="name a simulator; see `dynreg list --kind simulator`",
        )
    return found

"""A stored simulator as a live one, that is stepped by hand."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynreg.errors import UsageError
from dynreg.registry import Registry
from dynreg.verbs.simulator import NOMINAL, Simulator
from dynreg.verbs.simulators import named, own, simulator
from dynreg.verbs.subjects import loaded_robot

if TYPE_CHECKING:
    from dynreg.sim.live import LiveSimulator
    from dynreg.sim.robot import Robot


def live(
    registry: Registry, ref: str, robot: "str | Path | Robot | None" = None, **told: Any
) -> "LiveSimulator":
    """The simulator that `ref` names, at its start.

    ref : a simulator, an entry or a result that recommends one, by id or unique prefix, a word of `simulators.WORDS`,
    or "nominal" with a robot. robot : whose simulator it has to be; its own by default. told : as `LiveSimulator`.
    Raises NoMatchError where there is no such simulator, UsageError where it is of another robot, where no robot is
    named for "nominal", and as `LiveSimulator`.
    """
    from dynreg.sim.live import LiveSimulator

    found = _found(registry, ref, None if robot is None else loaded_robot(robot, registry=registry))
    return LiveSimulator(found.robot, found.config, **told)


def _found(registry: Registry, ref: str, robot: "Robot | None") -> Simulator:
    if ref != NOMINAL:
        found = named(registry, ref)
        return found if robot is None else own(found, robot)
    if robot is None:
        raise UsageError(
            f"the {NOMINAL!r} simulator of no robot",
            expected="a robot, by name or folder",
            do='name it, as in robot="quadruped"',
        )
    return simulator(registry, ref, robot)

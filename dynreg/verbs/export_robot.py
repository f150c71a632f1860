"""Export a stored simulator as a robot folder."""

from pathlib import Path

from dynreg.extend.folder_readme import PLAIN, Written
from dynreg.extend.robot_folder import export_robot
from dynreg.registry import Registry
from dynreg.results.robots import CarriedEffect, RobotFolder
from dynreg.verbs.simulators import stored, told_last
from dynreg.verbs.written import new_folder


def export_simulator(registry: Registry, ref: str, destination: Path) -> RobotFolder:
    """Write the stored simulator or entry `ref` as a robot folder.

    Raises as `export_robot`, NoMatchError where nothing is stored under `ref`, and UsageError where the name is taken
    or cannot be written. Where it fails or is killed no folder is left.
    """
    found = stored(registry, *registry.resolve(told_last(registry, ref), ("simulator", "entry")))
    with new_folder(destination) as folder:
        made = export_robot(found.robot, found.config, folder)
    plain = destination / Path(made.robot.file.robot.model).with_name(PLAIN)
    return RobotFolder(
        robot=found.config.robot_name,
        simulator=found.id,
        folder=str(destination),
        name=made.robot.name,
        effects=tuple(_told(one) for one in made.effects),
        mjcf=str(plain) if made.problem is None else None,
        note=made.problem or "",
    )


def _told(one: Written) -> CarriedEffect:
    parameters = one.term.effect.parameters
    return CarriedEffect(
        effect=one.term.key,
        values={p.name: float(value) for p, value in zip(parameters, one.values, strict=True)},
        units={p.name: p.unit for p in parameters},
        parameters=tuple(carrier.name for carrier in one.parameters),
        mjcf=one.in_mjcf,
    )

"""Export a stored simulator as a robot folder."""

from pathlib import Path

from dynreg.extend.folder_readme import PLAIN, Written
from dynreg.extend.robot_folder import export_robot
from dynreg.registry import Registry
from dynreg.results.robots import CarriedEffect, RobotFolder
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot


def export_simulator(registry: Registry, ref: str, destination: Path) -> RobotFolder:
    """Write the stored simulator or entry `ref` as a robot folder.

    Raises as `export_robot`, and NoMatchError where nothing is stored under `ref`.
    """
    kind, identity = registry.resolve(ref, ("simulator", "entry"))
    if kind == "simulator":
        config = SimConfig.from_dict(registry.simulator(identity))
    else:
        entry = registry.load_entry(identity)
        population = registry.population(entry.population_id)
        config = SimConfig(population.robot_hash, population.name, entry.values)
    made = export_robot(load_robot(registry.robot_folder(config.robot)), config, destination)
    plain = destination / Path(made.robot.file.robot.model).with_name(PLAIN)
    return RobotFolder(
        robot=config.robot_name,
        simulator=identity,
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

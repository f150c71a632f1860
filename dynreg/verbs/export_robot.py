"""Export a stored simulator as a robot folder."""

from collections.abc import Sequence
from pathlib import Path

from dynreg.errors import command
from dynreg.extend.folder_readme import Written, plain_name
from dynreg.extend.robot_folder import export_robot
from dynreg.registry import Registry
from dynreg.results.robots import CarriedEffect, RobotFolder
from dynreg.sim.effects import unit_of
from dynreg.sim.robot import Robot
from dynreg.verbs.in_mujoco import in_mujoco
from dynreg.verbs.simulator import NOMINAL, Simulator
from dynreg.verbs.simulators import named
from dynreg.verbs.written import new_folder


def export_simulator(registry: Registry, ref: str, destination: Path) -> RobotFolder:
    """Write the stored simulator or entry `ref`, or the one that the result `ref` recommends, as a robot folder.

    Raises as `export_robot`, NoMatchError where no simulator is stored under `ref`, and UsageError where the name is
    taken or cannot be written. Where it fails or is killed no folder is left.
    """
    found = named(registry, ref)
    with new_folder(destination) as folder:
        made = export_robot(found.robot, found.config, folder, found.id)
    model = destination / made.robot.file.robot.model
    plain = model.with_name(plain_name(made.robot))
    return RobotFolder(
        robot=found.config.robot_name,
        simulator=found.id,
        folder=str(destination),
        name=made.robot.name,
        effects=tuple(_told(one, found.robot) for one in made.effects),
        mjcf=str(plain) if made.problem is None else None,
        note=made.problem or "",
        model=str(model),
        warning=" ".join(
            filter(None, [_warning(found, made.effects, plain.name), in_mujoco(registry, found)])
        ),
    )


def _warning(found: Simulator, effects: Sequence[Written], plain: str) -> str:
    """What robot.toml lacks, and what has it: without this the folder is taken for the whole simulator."""
    untold = [one for one in effects if not one.parameters]
    nowhere = [one.term.key for one in untold if not one.in_mjcf]
    there = [one.term.key for one in untold if one.in_mjcf]
    said = []
    if nowhere:
        said.append(f"{_are(nowhere)} in neither file: the exported robot does not have {_them(nowhere)}.")
    if there:
        said.append(f"{_are(there)} in {plain} alone: dynreg runs the exported robot without {_them(there)}.")
    if untold:
        compare = command("compare", "RECORDING", "--with", f"{NOMINAL},{found.id[:12]}")
        gait = command("gait", "RECORDING", "--on", found.id[:12])
        used = " or ".join(f"`{one}`" for one in ([compare, gait] if found.robot.file.tasks else [compare]))
        has = "all of them" if len(effects) > 1 else "it"
        said.append(f"Simulator {found.id[:12]} has {has}: {used}.")
        said.append(f"What they are: `{command('effects')}`.")
    return " ".join(said)


def _are(keys: Sequence[str]) -> str:
    return f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'}"


def _them(keys: Sequence[str]) -> str:
    return "it" if len(keys) == 1 else "them"


def _told(one: Written, robot: Robot) -> CarriedEffect:
    parameters = one.term.effect.parameters
    return CarriedEffect(
        effect=one.term.key,
        values={p.name: float(value) for p, value in zip(parameters, one.values, strict=True)},
        units={p.name: unit_of(robot, one.term, p) for p in parameters},
        parameters=tuple(carrier.name for carrier in one.parameters),
        mjcf=one.in_mjcf,
    )

"""The families of gaits by kind, and the one that a robot is told; plugins through the entry points `dynreg.gaits`."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from dynreg.errors import RobotError, one_of
from dynreg.gait.family import Family
from dynreg.gait.locus import Locus
from dynreg.gait.poses import Poses
from dynreg.gait.sines import Sines
from dynreg.plugins import with_plugins
from dynreg.sim.robot import Robot


@cache
def families() -> Mapping[str, type[Family]]:
    """{kind: class} of dynreg's families and those of installed plugins; RobotError where a plugin is none."""
    packaged = {cls.kind: cls for cls in (Sines, Locus, Poses)}
    expected = "a class derived from dynreg.gait.family.Family, with its kind and all that it must give"
    return with_plugins(packaged, "dynreg.gaits", "kind", _made, expected)


def _made(plugin: Any) -> type[Family] | None:
    whole = isinstance(plugin, type) and issubclass(plugin, Family) and not plugin.__abstractmethods__
    return plugin if whole and hasattr(plugin, "kind") else None


def gait_space(robot: Robot, motion: str | None = None) -> Family:
    """The gaits of a robot, or what one of its motions can be, as its robot.toml gives them.

    Raises RobotError where it has no [gait] or no such motion, or where its kind is unknown.
    """
    tables = {table.name: table for table in robot.file.motions}
    table = robot.file.gait if motion is None else tables.get(motion)
    if table is None:
        raise RobotError(
            f"robot {robot.name!r} has no " + ("walking task" if motion is None else f"motion {motion!r}"),
            expected="[gait] with its legs and roles, and [[tasks]], in robot.toml"
            if motion is None
            else one_of(tables, motion, "robot.toml has no [[motions]]"),
            do="add them, or name a robot that walks, such as 'quadruped'",
        )
    offered = [kind for kind, family in families().items() if isinstance(table, family.told_by)]
    if table.kind not in offered:
        raise RobotError(
            f"{'[gait]' if motion is None else f'motion {motion!r}'} is of unknown kind {table.kind!r}",
            expected=f"one of {offered}",
            do="correct it in robot.toml, or install the plugin that brings it",
        )
    return families()[table.kind].of(robot, table)

"""The families of gaits by kind, and the one that a robot is told; plugins through the entry points `dynreg.gaits`."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from dynreg.errors import RobotError
from dynreg.gait.family import Family
from dynreg.gait.locus import Locus
from dynreg.gait.sines import Sines
from dynreg.plugins import with_plugins
from dynreg.sim.robot import Robot


@cache
def families() -> Mapping[str, type[Family]]:
    """{kind: class} of dynreg's families and those of installed plugins; RobotError where a plugin is none."""
    packaged = {cls.kind: cls for cls in (Sines, Locus)}
    expected = "a class derived from dynreg.gait.family.Family, with its kind and all that it must give"
    return with_plugins(packaged, "dynreg.gaits", "kind", _made, expected)


def _made(plugin: Any) -> type[Family] | None:
    whole = isinstance(plugin, type) and issubclass(plugin, Family) and not plugin.__abstractmethods__
    return plugin if whole and hasattr(plugin, "kind") else None


def gait_space(robot: Robot) -> Family:
    """The gaits of a robot, as its robot.toml gives them; RobotError where it has no [gait] or its kind is unknown."""
    table = robot.file.gait
    if table is None:
        raise RobotError(
            f"robot {robot.name!r} has no walking task",
            expected="[gait] with its legs and roles, and [[tasks]], in robot.toml",
            do="add them, or name a robot that walks, such as 'quadruped'",
        )
    if table.kind not in families():
        raise RobotError(
            f"[gait] is of unknown kind {table.kind!r}",
            expected=f"one of {list(families())}",
            do="correct it in robot.toml, or install the plugin that brings it",
        )
    return families()[table.kind].of(robot, table)

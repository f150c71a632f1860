"""Causes of independent truths by kind of row: of the library's physics, of other physics, without a name."""

from dataclasses import dataclass

from dynreg.sim.effects import applicable
from dynreg.sim.robot import Robot
from dynreg.truths.causes import CAUSES
from dynreg.truths.table import causes_of

# To a log of wheels an encoder's scale is the wheels' size and the drags at once (see bench_naming_wheels).
UNTOLD = {"diffdrive": ("encoder_scale",)}


@dataclass(frozen=True)
class Rows:
    """Ids of the causes of a robot that are drawn for each kind of row."""

    same: tuple[str, ...]
    other: tuple[str, ...]
    outside: tuple[str, ...]


def rows_of(robot: Robot) -> Rows:
    """Causes of the library's physics, of other physics with a name that the robot's library has, and without one."""
    able = applicable(robot)
    other = causes_of(robot.name, "other")
    named = tuple(c for c in other if any(name in able for name in CAUSES[c].names))
    same = (c for c in causes_of(robot.name, "same") if c not in UNTOLD.get(robot.name, ()))
    return Rows(tuple(same), named, tuple(c for c in other if c not in named))

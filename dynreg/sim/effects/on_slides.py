"""Slides among the joints of a robot: units of effects, which are written for hinges."""

from collections.abc import Iterable
from types import MappingProxyType

import mujoco

from dynreg.sim.robot import Robot

ON_SLIDES = MappingProxyType(  # units of effects, as they are written for hinges
    {
        "rad": "m",
        "rad/s": "m/s",
        "rad/(N*m)": "m/N",
        "N*m": "N",
        "N*m/s": "N/s",
        "N*m/rad": "N/m",
        "N*m*s/rad": "N*s/m",
        "N*m*s^2/rad^2": "N*s^2/m^2",
        "kg*m^2": "kg",
    }
)


def slides_of(robot: Robot) -> tuple[str, ...]:
    """The driven joints that slide; none of a planar base, which has no joints."""
    model, slide = robot.model, mujoco.mjtJoint.mjJNT_SLIDE
    return tuple(j for j in robot.driven if model.joint(j).type[0] == slide) if model.njnt else ()


def unit_at(robot: Robot, joints: Iterable[str], unit: str) -> str:
    """A unit as it is written for hinges, at these joints: where all slide, of forces and metres.

    >>> from dynreg.sim.robot import load_robot
    >>> unit_at(load_robot("emps"), ["slider"], "N*m"), unit_at(load_robot("leg"), ["knee"], "N*m")
    ('N', 'N*m')
    """
    return ON_SLIDES.get(unit, unit) if {*joints} <= {*slides_of(robot)} else unit

"""Slides among the joints of a robot: units of effects, which are written for hinges, and what a radian is there."""

from collections.abc import Iterable
from types import MappingProxyType

import mujoco

from dynreg.sim.robot import Robot

ON_SLIDES = (
    MappingProxyType(  # units of effects, as they are written for hinges: on slides, and powers of a radian
        {
            "rad": ("m", 1),
            "rad/s": ("m/s", 1),
            "rad/(N*m)": ("m/N", 0),  # in multiples of what a slide's own stiffness gives
            "N*m": ("N", 0),
            "N*m/s": ("N/s", 0),
            "N*m/rad": ("N/m", -1),
            "N*m*s/rad": ("N*s/m", -1),
            "N*m*s^2/rad^2": ("N*s^2/m^2", -2),
            "kg*m^2": ("kg", 0),
        }
    )
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
    return ON_SLIDES.get(unit, (unit, 0))[0] if {*joints} <= {*slides_of(robot)} else unit


def power_of_radians(unit: str) -> int:
    """How often a size in a unit, as it is written for hinges, has a radian in it that no other quantity stands for.

    >>> power_of_radians("rad/s"), power_of_radians("N*m*s/rad"), power_of_radians("N*m")
    (1, -1, 0)
    """
    return ON_SLIDES.get(unit, (unit, 0))[1]

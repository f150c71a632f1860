"""Slides among the joints of a robot: units of effects, which are written for hinges, and what only turns."""

from collections.abc import Iterable
from types import MappingProxyType

import mujoco

from dynreg.sim.effects.effect import EffectParameter, Term
from dynreg.sim.robot import Robot

ON_SLIDES = MappingProxyType(  # units of effects, as they are written for hinges
    {
        "rad": "m",
        "rad/s": "m/s",
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


def unit_of(robot: Robot, term: Term, parameter: EffectParameter) -> str:
    """The unit of an effect's parameter where it acts: on slides, forces and metres instead of torques and angles.

    A drive that is told a speed has commands in the unit of its action; where those of a base differ (speed and yaw
    rate), one number is of each in its own: "m/s or rad/s".
    """
    if robot.planar and parameter.per == "command":
        told = dict.fromkeys(action.unit for action in robot.file.actions)
        return " or ".join(unit if parameter.unit == "rad" else unit.replace("/s", "/s^2") for unit in told)
    if term.effect.scope != "joint" or robot.planar:
        return parameter.unit
    return unit_at(robot, term.joints or robot.driven, parameter.unit)

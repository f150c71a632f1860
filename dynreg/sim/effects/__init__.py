"""Effects: the library of physical causes, one class each, by stable id; plugins through entry points."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from dynreg.errors import UsageError, one_of
from dynreg.plugins import with_plugins
from dynreg.sim.effects import body, command, contact, drive, friction, sensor, stand, transmission, wheels
from dynreg.sim.effects.effect import (
    Effect,
    EffectParameter,
    Moment,
    Site,
    Term,
    Terms,
    Values,
    one_group,
    stacked,
    unit_of,
)
from dynreg.sim.robot import Robot
from dynreg.sim.sizes import SIZES

_PACKAGED = (
    command.CommandDelay,
    command.CommandGain,
    command.RateLimit,
    command.ProfileSpeed,
    command.CommandLag,
    command.CommandDeadband,
    wheels.TurnSlowdown,
    drive.DutyLimit,
    drive.TorqueLimit,
    drive.SpeedLimit,
    drive.DriveGain,
    drive.VoltageSag,
    drive.ThermalFade,
    drive.Cogging,
    drive.ForceOffset,
    drive.FeedbackDelay,
    drive.TorqueLag,
    wheels.WheelGain,
    wheels.DriveInertia,
    friction.CoulombFriction,
    friction.ViscousFriction,
    friction.StribeckFriction,
    friction.LoadFriction,
    friction.StribeckLoadFriction,
    friction.AsymmetricFriction,
    friction.AsymmetricViscous,
    friction.FrictionDrift,
    friction.QuadraticDrag,
    transmission.Backlash,
    transmission.JointElasticity,
    transmission.MotorBacklash,
    transmission.MotorElasticity,
    transmission.CableCoupling,
    body.Payload,
    body.ComOffset,
    body.Inertia,
    body.GravityTilt,
    stand.StandCompliance,
    contact.GroundFriction,
    contact.SecondFrictionMaterial,
    contact.ContactCompliance,
    wheels.WheelSlip,
    sensor.EncoderOffset,
    sensor.EncoderScale,
    sensor.EncoderEccentricity,
    sensor.SensorDelay,
    sensor.ClockError,
    sensor.ImuMisalignment,
)


def _made(plugin: Any) -> Effect | None:
    made = plugin()
    return made if isinstance(made, Effect) else None


@cache
def effects() -> Mapping[str, Effect]:
    """{id: effect}: those of dynreg, in the order in which they act, and those of installed plugins.

    A plugin is an `Effect` subclass under the entry point group `dynreg.effects`; RobotError where one is none.
    """
    packaged = {cls.id: cls() for cls in _PACKAGED}
    expected = "a class derived from dynreg.sim.effects.Effect"
    return with_plugins(packaged, "dynreg.effects", "id", _made, expected)


def effect(name: str) -> Effect:
    """The effect of that id; UsageError with the choices where there is none."""
    table = effects()
    if name not in table:
        raise UsageError(f"unknown effect {name!r}", expected=one_of(table, name), do="see `dynreg effects`")
    return table[name]


def term(key: str) -> Term:
    """The term that a key such as "load_friction", "backlash[fl_hip]" or "payload[flange]" names.

    Raises UsageError where it is none.
    """
    name, bracket, places = key.partition("[")
    if bracket and not places.endswith("]"):
        raise UsageError(f"effect {key!r}", expected="EFFECT or EFFECT[JOINT,...]", do="close the bracket")
    chosen = tuple(p.strip() for p in places[:-1].split(",")) if bracket else ()
    return Term(effect(name), chosen)


def applicable(robot: Robot) -> dict[str, Effect]:
    """{id: effect} of those that can act on a robot."""
    return {name: e for name, e in effects().items() if e.why_not(robot) is None}


def placed(robot: Robot, effect: Effect) -> list[Term]:
    """The effect at every place where it is looked for: all joints and each, bodies, tools or materials."""
    return [Term(effect, at) for at in effect.places(robot)]


__all__ = [
    "SIZES",
    "Effect",
    "EffectParameter",
    "Moment",
    "Site",
    "Term",
    "Terms",
    "Values",
    "applicable",
    "effect",
    "effects",
    "one_group",
    "placed",
    "stacked",
    "term",
    "unit_of",
]

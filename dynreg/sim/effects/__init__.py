"""Effects: the library of physical causes, one class each, by stable id; plugins through entry points."""

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType

from dynreg.errors import RobotError, UsageError
from dynreg.sim.effects import body, command, contact, drive, friction, sensor, transmission, wheels
from dynreg.sim.effects.effect import SIZES, Effect, EffectParameter, Moment, Site, Term, Terms, Values

_PACKAGED = (
    command.CommandDelay,
    command.CommandGain,
    command.RateLimit,
    command.CommandLag,
    command.CommandDeadband,
    drive.TorqueLimit,
    drive.SpeedLimit,
    drive.DriveGain,
    drive.VoltageSag,
    drive.ThermalFade,
    drive.Cogging,
    drive.ForceOffset,
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
    body.Payload,
    body.ComOffset,
    body.Inertia,
    body.GravityTilt,
    contact.GroundFriction,
    contact.SecondFrictionMaterial,
    contact.ContactCompliance,
    wheels.WheelSlip,
    sensor.EncoderOffset,
    sensor.EncoderScale,
    sensor.SensorDelay,
    sensor.ClockError,
    sensor.ImuMisalignment,
)


def _made(point: EntryPoint) -> Effect:
    """The effect of an installed plugin; RobotError where it cannot be made, whatever the reason."""
    try:
        plugin = point.load()()
    except Exception as error:
        raise RobotError(
            f"plugin {point.value} cannot be loaded: {type(error).__name__}: {error}",
            expected="a class derived from dynreg.sim.effects.Effect",
            do="mend it, or uninstall its package",
        ) from error
    return plugin


@cache
def effects() -> Mapping[str, Effect]:
    """{id: effect}: those of dynreg, in the order in which they act, and those of installed plugins.

    A plugin is an `Effect` subclass under the entry point group `dynreg.effects`.
    """
    table = {cls.id: cls() for cls in _PACKAGED}
    for point in entry_points(group="dynreg.effects"):
        plugin = _made(point)
        if plugin.id in table:
            raise RobotError(
                f"plugin {point.value} brings an effect {plugin.id!r}",
                expected="an id that is not taken",
                do="rename it",
            )
        table[plugin.id] = plugin
    return MappingProxyType(table)


def effect(name: str) -> Effect:
    """The effect of that id; UsageError with the choices where there is none."""
    table = effects()
    if name not in table:
        raise UsageError(
            f"unknown effect {name!r}", expected=f"one of {list(table)}", do="see `dynreg effects`"
        )
    return table[name]


def term(key: str) -> Term:
    """The term that a key such as "load_friction" or "backlash[fl_hip]" names; UsageError where it is none."""
    name, bracket, joints = key.partition("[")
    if bracket and not joints.endswith("]"):
        raise UsageError(f"effect {key!r}", expected="EFFECT or EFFECT[JOINT,...]", do="close the bracket")
    chosen = tuple(j.strip() for j in joints[:-1].split(",")) if bracket else ()
    return Term(effect(name), chosen)


def applicable(robot) -> dict[str, Effect]:
    """{id: effect} of those that can act on a robot."""
    return {name: e for name, e in effects().items() if e.why_not(robot) is None}


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
    "term",
]

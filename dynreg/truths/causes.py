"""What can be hidden in a truth: each cause with its sizes, and the names in the library that are right for it.

Sizes are multiples of a unit of the kind (its torque limit, the stiffness of its servo, ...), so that with `Units` they
are SI. They were written down before any report: those of causes that the library has are the library's contract, the
others lie in the same spirit (they move a joint by as much).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dynreg.errors import UsageError, one_of
from dynreg.rng import stream

SIZES = ("weak", "medium", "strong")
DEGREE = np.pi / 180
FAST = 6.0  # rad/s, at which friction that grows with speed is sized: by contract
SPREAD = 3.0  # a shape is drawn between its usual value over and times the root of this: by contract


@dataclass(frozen=True)
class Size:
    """One number of a cause: weak, medium, strong in multiples of the unit `per`.

    per : "1" for SI as it stands, "torque" [N m], "stiffness" [rad/(N m)], "inertia" [kg m^2], "length" [m], "command"
    (the largest speed [rad/s] of a drive that is told one; else 1), "mass" [kg]. signed : drawn with either sign.
    shape : drawn about the one value.
    """

    weak: float
    medium: float
    strong: float
    per: str = "1"
    signed: bool = False
    shape: bool = False


@dataclass(frozen=True)
class Cause:
    """One cause.

    sizes : {parameter: Size}, named as the library's effect names them where `same`. same : the physics is that of
    the library's effect of this id. names : effects that are right names for it; () where it lies outside the library.
    joints : how many a robot must have for it.
    """

    sizes: Mapping[str, Size]
    same: bool
    names: tuple[str, ...] = ()
    joints: int = 1


@dataclass(frozen=True)
class Units:
    """What sizes are multiples of, for one kind [SI]."""

    torque: float = 1.0
    stiffness: float = 1.0
    inertia: float = 1.0
    length: float = 1.0
    command: float = 1.0
    mass: float = 1.0

    def of(self, per: str) -> float:
        """One unit."""
        return 1.0 if per == "1" else getattr(self, per)


def _torque(weak: float, medium: float, strong: float, over: float = 1.0, signed: bool = False) -> Size:
    return Size(weak / over, medium / over, strong / over, "torque", signed)


def _angle(weak: float, medium: float, strong: float, per: str = "1", signed: bool = False) -> Size:
    return Size(weak * DEGREE, medium * DEGREE, strong * DEGREE, per, signed)


FADES = Size(0.3, 0.3, 0.3, shape=True)  # rad/s

# The library's own causes: same physics, other code.
_SAME: Mapping[str, Cause] = {
    "coulomb_friction": {"torque": _torque(0.01, 0.03, 0.08)},
    "viscous_friction": {"coefficient": _torque(0.05, 0.15, 0.40, FAST)},
    "stribeck_friction": {
        "extra": _torque(0.02, 0.05, 0.10),
        "coulomb": _torque(0.01, 0.025, 0.05),
        "velocity": FADES,
    },
    "load_friction": {"coefficient": Size(0.03, 0.08, 0.2)},
    "stribeck_load_friction": {
        "extra": Size(0.05, 0.10, 0.20),
        "coefficient": Size(0.02, 0.05, 0.10),
        "growth": Size(0.05, 0.10, 0.20),
        "velocity": FADES,
    },
    "asymmetric_friction": {
        "difference": _torque(0.007, 0.018, 0.035, signed=True),
        "mean": _torque(0.0105, 0.027, 0.0525),
    },
    "asymmetric_viscous": {"difference": _torque(0.02, 0.06, 0.15, FAST, signed=True)},
    "friction_drift": {"rate": _torque(0.06, 0.15, 0.3, 20.0)},
    "quadratic_drag": {"coefficient": _torque(0.02, 0.06, 0.15, FAST**2)},
    "torque_limit": {"loss": Size(0.12, 0.25, 0.40)},
    "speed_limit": {"no_load_speed": Size(25.0, 12.5, 6.3)},
    "drive_gain": {"gain": Size(0.10, 0.25, 0.40, signed=True)},
    "voltage_sag": {"sag": Size(0.03, 0.08, 0.20)},
    "thermal_fade": {"fade": Size(0.15, 0.40, 0.90)},
    "cogging": {
        "sine": _torque(0.009, 0.026, 0.07, signed=True),
        "cosine": _torque(0.009, 0.026, 0.07, signed=True),
        "count": Size(12.0, 12.0, 12.0),  # a turn
    },
    "force_offset": {"torque": _torque(0.01, 0.03, 0.08, signed=True)},
    "backlash": {"gap": _angle(0.3, 1.0, 3.0)},
    "joint_elasticity": {"compliance": Size(0.0125, 0.0375, 0.1125, "stiffness")},
    "payload": {"mass": Size(0.05, 0.15, 0.40, "mass")},
    "com_offset": {"shift": Size(0.0175, 0.0524, 0.14, "length", signed=True)},
    "inertia": {"armature": Size(0.10, 0.30, 0.70, "inertia")},
    "gravity_tilt": {"angle": _angle(1.0, 3.0, 8.0, signed=True)},
    "encoder_eccentricity": {
        "sine": _angle(0.2, 0.7, 1.8, signed=True),
        "cosine": _angle(0.2, 0.7, 1.8, signed=True),
    },
    "encoder_offset": {"offset": _angle(1.0, 3.0, 8.0, signed=True)},
    "clock_error": {"error": Size(0.01, 0.03, 0.08, signed=True)},
}
_SAME_ON_BOTH = {
    "command_delay": {"delay": Size(0.005, 0.010, 0.020)},
    "command_lag": {"time": Size(0.005, 0.012, 0.030)},
    "command_gain": {"gain": Size(0.02, 0.06, 0.15, signed=True)},
    "command_deadband": {"width": _angle(0.3, 1.0, 2.5, "command")},
    "rate_limit": {"rate": Size(10.0, 5.0, 2.5, "command")},
    "encoder_scale": {"error": Size(0.01, 0.03, 0.08, signed=True)},
    "sensor_delay": {"delay": Size(0.004, 0.008, 0.015)},
}
_SAME_ON_WHEELS = {
    "wheel_gain": {"difference": Size(0.02, 0.06, 0.15, signed=True)},
    "wheel_slip": {"grip": Size(2.0, 1.0, 0.5)},
    "drive_inertia": {"time": Size(0.02, 0.05, 0.12)},
    "turn_slowdown": {"arm": Size(0.005, 0.015, 0.04)},
}
# The same names for other physics, and what has no name.
_OTHER: Mapping[str, Cause] = {
    # bristles that bend before they slide (Dahl 1968; Canudas de Wit et al. 1995): breakaway after `bend` [rad]
    "dahl_friction": Cause(
        {"torque": _torque(0.01, 0.03, 0.08), "bend": Size(0.004, 0.004, 0.004, shape=True)},
        False,
        ("coulomb_friction", "stribeck_friction"),
    ),
    "lugre_friction": Cause(
        {
            "extra": _torque(0.02, 0.05, 0.10),
            "coulomb": _torque(0.01, 0.025, 0.05),
            "velocity": FADES,
            "bend": Size(0.004, 0.004, 0.004, shape=True),
        },
        False,
        ("stribeck_friction", "coulomb_friction"),
    ),
    # the encoder sits on the motor: neither the drive nor the log sees the play
    "motor_backlash": Cause({"gap": _angle(0.3, 1.0, 3.0)}, False, ("motor_backlash", "backlash")),
    "motor_elasticity": Cause(
        {"compliance": Size(0.0125, 0.0375, 0.1125, "stiffness")},
        False,
        ("motor_elasticity", "joint_elasticity"),
    ),
    # the encoder sits on the joint, but the motor's back-EMF brakes the motor, which is free within the play
    "braked_backlash": Cause({"gap": _angle(0.3, 1.0, 3.0)}, False, ("backlash",)),
    "braked_elasticity": Cause(
        {"compliance": Size(0.0125, 0.0375, 0.1125, "stiffness")}, False, ("joint_elasticity",)
    ),
    "feedback_delay": Cause({"delay": Size(0.003, 0.008, 0.016)}, False, ("feedback_delay",)),
    "torque_lag": Cause({"time": Size(0.003, 0.008, 0.020)}, False, ("torque_lag",)),
    # copper warms in 4 s and cools to a housing that warms in 60 s, through rests between the episodes, too
    "heat_build_up": Cause({"fade": Size(0.15, 0.40, 0.90)}, False, ("thermal_fade",)),
    "cogging_7": Cause({"ripple": _torque(0.013, 0.037, 0.10)}, False, ("cogging",)),
    "cogging_24": Cause({"ripple": _torque(0.013, 0.037, 0.10)}, False, ("cogging",)),
    "profile_speed": Cause(
        {"speed": Size(10.0, 5.0, 2.5), "acceleration": Size(100.0, 60.0, 40.0)},
        False,
        ("profile_speed", "rate_limit"),
    ),
    "soft_stand": Cause(
        {"compliance": Size(0.0125, 0.0375, 0.1125, "stiffness")}, False, ("stand_compliance",)
    ),
    "cable_coupling": Cause({"stiffness": _torque(0.01, 0.03, 0.08)}, False, ("cable_coupling",), joints=2),
    # a worn tooth, a dry spot of a bearing: dry friction that is larger about one angle
    "friction_patch": Cause(
        {
            "torque": _torque(0.03, 0.08, 0.2),
            "angle": Size(0.5, 0.5, 0.5, shape=True, signed=True),
            "width": Size(0.15, 0.15, 0.15, shape=True),
        },
        False,
    ),
    "coloured_disturbance": Cause({"torque": _torque(0.015, 0.04, 0.10)}, False),
}
_OTHER_ON_WHEELS: Mapping[str, Cause] = {
    # tyres creep in proportion to what they push, and never hold (Pacejka's linear range)
    "wheel_creep": Cause({"time": Size(0.01, 0.03, 0.08)}, False, ("wheel_slip", "drive_inertia")),
    # two lags, one after the other, in place of one more
    "second_lag": Cause({"time": Size(0.02, 0.05, 0.12)}, False, ("drive_inertia", "command_lag")),
    # a wheel whose hub is off its middle: its radius changes once a turn
    "eccentric_wheel": Cause({"error": Size(0.03, 0.08, 0.20)}, False),
    "coloured_speed": Cause({"speed": Size(0.02, 0.06, 0.15, "command")}, False),
}


def _table() -> dict[str, Cause]:
    sizes = _SAME | _SAME_ON_BOTH | _SAME_ON_WHEELS
    return {name: Cause(own, True, (name,)) for name, own in sizes.items()} | _OTHER | _OTHER_ON_WHEELS


CAUSES: Mapping[str, Cause] = MappingProxyType(_table())


def cause(name: str) -> Cause:
    """The cause of that id; UsageError with the choices where there is none."""
    if name not in CAUSES:
        raise UsageError(
            f"a hidden robot has no cause {name!r}", expected=one_of(CAUSES, name), do="correct it"
        )
    return CAUSES[name]


def drawn(name: str, size: str, units: Units, seed: int) -> dict[str, float]:
    """{parameter: value [SI]} of a cause at a size; signs, shapes and phases are drawn from `seed`."""
    rng = stream(seed, "truth", name)
    values = {}
    for key, s in cause(name).sizes.items():
        value = getattr(s, size) * units.of(s.per)
        if s.shape:
            value *= SPREAD ** rng.uniform(-0.5, 0.5)
        if s.signed:
            value *= rng.choice([-1.0, 1.0])
        values[key] = float(value)
    return values

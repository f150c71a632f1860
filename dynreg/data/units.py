"""Units in which logs are written, the SI unit that each becomes, and how a value shows its unit."""

import math
from types import MappingProxyType

from dynreg.errors import MapError

_TURN = 2.0 * math.pi
_G = 9.80665

# unit: (SI unit, factor, offset), so that SI = factor * value + offset
UNITS = MappingProxyType(
    {
        "1": ("1", 1.0, 0.0),
        "percent": ("1", 0.01, 0.0),
        "%": ("1", 0.01, 0.0),
        "permille": ("1", 0.001, 0.0),
        "rad": ("rad", 1.0, 0.0),
        "mrad": ("rad", 1e-3, 0.0),
        "deg": ("rad", _TURN / 360.0, 0.0),
        "turn": ("rad", _TURN, 0.0),
        "rev": ("rad", _TURN, 0.0),
        "rad/s": ("rad/s", 1.0, 0.0),
        "deg/s": ("rad/s", _TURN / 360.0, 0.0),
        "rpm": ("rad/s", _TURN / 60.0, 0.0),
        "rev/s": ("rad/s", _TURN, 0.0),
        "rad/s^2": ("rad/s^2", 1.0, 0.0),
        "deg/s^2": ("rad/s^2", _TURN / 360.0, 0.0),
        "m": ("m", 1.0, 0.0),
        "cm": ("m", 1e-2, 0.0),
        "mm": ("m", 1e-3, 0.0),
        "um": ("m", 1e-6, 0.0),
        "in": ("m", 0.0254, 0.0),
        "m/s": ("m/s", 1.0, 0.0),
        "cm/s": ("m/s", 1e-2, 0.0),
        "mm/s": ("m/s", 1e-3, 0.0),
        "km/h": ("m/s", 1.0 / 3.6, 0.0),
        "m/s^2": ("m/s^2", 1.0, 0.0),
        "g0": ("m/s^2", _G, 0.0),
        "N": ("N", 1.0, 0.0),
        "mN": ("N", 1e-3, 0.0),
        "kN": ("N", 1e3, 0.0),
        "kgf": ("N", _G, 0.0),
        "N*m": ("N*m", 1.0, 0.0),
        "Nm": ("N*m", 1.0, 0.0),
        "mN*m": ("N*m", 1e-3, 0.0),
        "kgf*cm": ("N*m", _G * 1e-2, 0.0),
        "V": ("V", 1.0, 0.0),
        "mV": ("V", 1e-3, 0.0),
        "A": ("A", 1.0, 0.0),
        "mA": ("A", 1e-3, 0.0),
        "W": ("W", 1.0, 0.0),
        "kg": ("kg", 1.0, 0.0),
        "g": ("kg", 1e-3, 0.0),
        "kg*m^2": ("kg*m^2", 1.0, 0.0),
        "s": ("s", 1.0, 0.0),
        "ms": ("s", 1e-3, 0.0),
        "us": ("s", 1e-6, 0.0),
        "ns": ("s", 1e-9, 0.0),
        "Hz": ("Hz", 1.0, 0.0),
        "kHz": ("Hz", 1e3, 0.0),
        "degC": ("degC", 1.0, 0.0),
        "K": ("degC", 1.0, -273.15),
        "degF": ("degC", 5.0 / 9.0, -160.0 / 9.0),
    }
)

# as headers write units: as maps do
CALLED = MappingProxyType(
    {
        **{name: "deg" for name in ("°", "º", "degree", "degrees", "Deg", "DEG")},
        **{name: "deg/s" for name in ("°/s", "º/s", "degree/s", "degrees/s", "Deg/s", "DEG/s", "dps")},
        **{name: "deg/s^2" for name in ("°/s^2", "°/s²", "º/s²", "degrees/s^2", "deg/s2", "deg/s²")},
        **{name: "rad" for name in ("radian", "radians", "Rad", "RAD")},
        **{name: "rad/s" for name in ("radian/s", "radians/s", "Rad/s", "RAD/s")},
        **{name: "rad/s^2" for name in ("rad/s2", "rad/s²")},
        **{name: "m/s^2" for name in ("m/s2", "m/s²")},
        **{name: "N*m" for name in ("N.m", "N·m", "N m")},
        **{name: "mN*m" for name in ("mNm", "mN.m", "mN·m", "mN m")},
        **{name: "degC" for name in ("°C", "ºC")},
        **{name: "rpm" for name in ("RPM", "1/min", "rev/min")},
    }
)


def unit_called(name: str) -> str | None:
    """The unit of a map that a header calls so; None for what is no unit.

    >>> unit_called("°/s"), unit_called("mNm"), unit_called("V"), unit_called("elbow")
    ('deg/s', 'mN*m', 'V', None)
    """
    return name if name in UNITS else CALLED.get(name)


def conversion(unit: str, to: str) -> tuple[float, float]:
    """Factor and offset that take a value in `unit` to the unit `to`.

    >>> conversion("deg", "rad")[0] * 180
    3.141592653589793

    Raises MapError for an unknown unit and for units of different kinds.
    """
    if unit == to:
        return 1.0, 0.0
    if unit not in UNITS:
        raise MapError(
            f"unknown unit {unit!r}", expected=f"one of {', '.join(UNITS)}", do="use `scale` and an SI unit"
        )
    si, factor, offset = UNITS[unit]
    target, target_factor, target_offset = UNITS.get(to, (to, 1.0, 0.0))
    if si != target:
        choices = ", ".join(name for name, entry in UNITS.items() if entry[0] == target)
        raise MapError(
            f"unit {unit!r} cannot become {to!r}",
            expected=f"one of {choices or to}",
            do="correct the unit, or check that the source is the right one",
        )
    return factor / target_factor, (offset - target_offset) / target_factor


def suffix(unit: str) -> str:
    """What stands behind a value in this unit: a plain number has nothing behind it.

    >>> suffix("kg"), suffix("1")
    (' kg', '')
    """
    return "" if unit == "1" else f" {unit}"

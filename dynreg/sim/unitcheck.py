"""Units of a robot.toml: known, SI, and those of the joints that they stand for."""

import re
from collections.abc import Iterator
from types import MappingProxyType

from dynreg.data.names import parts_of
from dynreg.data.units import UNITS
from dynreg.errors import RobotError
from dynreg.sim.finding import Said
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import Robot

# factors of a parameter's or setting's unit, as in "N*m*s/rad"
_FACTORS = frozenset({"1", "rad", "m", "s", "kg", "N", "V", "A", "W", "J", "Hz", "Pa", "ohm", "H", "degC"})
_QUANTITIES = MappingProxyType(
    {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}
    | {"vx": "m/s", "vy": "m/s", "vz": "m/s", "wx": "rad/s", "wy": "rad/s", "wz": "rad/s"}
    | {"speed": "m/s", "yaw_rate": "rad/s", "speed_command": "m/s", "yaw_rate_command": "rad/s"}
)


def unit_problems(robot: Robot) -> Iterator[Said]:
    """Units that are unknown, not SI, or not those of the quantity, one line each."""
    for group in ("channels", "actions", "inputs"):
        for table in getattr(robot.file, group):
            told = _signal_problem(robot, table.name, table.unit, joint=group != "inputs")
            if told is not None:
                yield (group, table.name, "unit"), f"unit {table.unit!r} of {table.name!r} {told}"
    both = [("parameters", t) for t in robot.file.parameters] + [("settings", t) for t in robot.file.settings]
    for group, table in both:
        factors = re.split(r"[*/]", table.unit)
        unknown = [f for f in factors if re.sub(r"\^\d+$", "", f.strip()) not in _FACTORS]
        if unknown:
            told = f"unit {table.unit!r} of {table.name!r} has an unknown factor {unknown[0]!r}"
            yield (group, table.name, "unit"), f"{told}; build it with * / ^ from {sorted(_FACTORS)}"


def _signal_problem(robot: Robot, name: str, unit: str, joint: bool) -> str | None:
    """What is wrong with the unit of a channel, a command (`joint`) or an input."""
    if unit not in UNITS:
        return f"is unknown; use one of {_si_units()}"
    if UNITS[unit][0] != unit:
        return f"is not SI; use {UNITS[unit][0]!r}"
    expected = _expected(robot, name) if joint else None
    return None if expected in (None, unit) else f"is not that of its joint; use {expected!r}"


def _si_units() -> list[str]:
    return [name for name, (si, _, _) in UNITS.items() if name == si]


def _expected(robot: Robot, name: str) -> str | None:
    """The SI unit of a channel or a command, None where its drive leaves it open."""
    owner, quantity = parts_of(name)
    kinds = {robot.model.joint(j).name: int(robot.model.jnt_type[j]) for j in range(robot.model.njnt)}
    length = {2: "m", 3: "rad"}.get(kinds.get(owner, -1))  # mjJNT_SLIDE, mjJNT_HINGE
    if length is None:
        return _QUANTITIES.get(quantity)
    if name in robot.channels:
        return {"position": length, "velocity": f"{length}/s"}.get(quantity)
    try:
        kind = nominal_ports(robot, 1).types[robot.actions.index(name)]
    except RobotError:  # told where names are checked
        return None
    return {"position": length, "duty_servo": length, "dcmotor": "V", "speed": f"{length}/s"}.get(kind)

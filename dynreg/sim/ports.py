"""The ports where parameters, settings and effects act: drives, friction, sensors, a wheeled base, control.

Both engines read the same `Ports`, and one torque law (`servo_law`) serves every drive on every engine.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

import numpy as np

from dynreg.errors import RobotError, SimulationError, quoted
from dynreg.sim.engine import engines_with
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.sim.sets import DRIVE_DEFAULTS, PORT_KEYS, Assignment, combine, is_limit, matching


@dataclass
class Ports:
    """Port values of B simulators: drive, friction and sensor (B, A), control and base (B,).

    Encoders read scale (q + offset), to the drives and to the log; `control.clock` is a factor on time: the
    simulator takes `clock` seconds for one of the log.

    joints, actions, types : the driven joint, name and drive law of each action. base : what [base] of robot.toml
    says of a base on two wheels; empty where it has none.
    """

    joints: list[str]
    types: list[str]
    drive: dict[str, np.ndarray]
    friction: dict[str, np.ndarray]
    sensor: dict[str, np.ndarray]
    control: dict[str, np.ndarray]
    supply_input: np.ndarray
    enable_input: np.ndarray
    actions: list[str] = field(default_factory=list)
    base: dict[str, np.ndarray] = field(default_factory=dict)

    def apply(self, assignment: Assignment, values: np.ndarray) -> None:
        """Set one port from (B,) values."""
        if assignment.root == "control":
            old = self.control[assignment.path]
            self.control[assignment.path] = np.array(combine(assignment.op, old, values))
            return
        port, _, key = assignment.path.partition(".")
        if port == "base":
            if not self.base:
                raise RobotError(
                    f"sets entry {assignment.text!r}: the robot has no base on wheels",
                    expected="a [base] table in robot.toml",
                    do="add it, or correct the entry",
                )
            self.base[key] = np.array(combine(assignment.op, self.base[key], values))
            return
        array = getattr(self, port)[key]
        # a base has two drives under one name: elements with a slash are actions, the others joints
        whole = any("/" in element for element in assignment.elements)
        at = matching(self.actions if whole else self.joints, assignment.elements, assignment.text)
        array[:, at] = combine(assignment.op, array[:, at], values)

    def repeat(self, times: int) -> "Ports":
        """Each simulator `times` times in a row."""
        spread = lambda group: {k: np.repeat(v, times, axis=0) for k, v in group.items()}  # noqa: E731
        groups = ("drive", "friction", "sensor", "control", "base")
        return replace(self, **{group: spread(getattr(self, group)) for group in groups})


def nominal_ports(robot: Robot, n: int) -> Ports:
    """Ports as robot.toml gives them, for n simulators."""
    joints = list(robot.joints)
    tables = [_drive_of(robot, *names) for names in zip(robot.joints, robot.actions, strict=True)]
    drive = {
        key: np.tile(np.array([getattr(t, key, DRIVE_DEFAULTS[key]) for t in tables], dtype=float), (n, 1))
        for key in PORT_KEYS["drive"]
    }
    inputs, wheels = list(robot.inputs), robot.file.base
    find = lambda name: inputs.index(name) if name else -1  # noqa: E731
    return Ports(
        joints,
        [t.law for t in tables],
        drive,
        {key: np.zeros((n, len(joints))) for key in PORT_KEYS["friction"]},
        {"offset": np.zeros((n, len(joints))), "scale": np.ones((n, len(joints)))},
        {
            "rate": np.full(n, robot.file.robot.control_rate or 0.0),
            "noise": np.zeros(n),
            "max_step": np.full(n, np.inf),
            "clock": np.ones(n),
        },
        np.array([find(getattr(t, "supply_input", None)) for t in tables], dtype=int),
        np.array([find(t.enable) for t in tables], dtype=int),
        list(robot.actions),
        {} if wheels is None else {key: np.full(n, getattr(wheels, key)) for key in PORT_KEYS["base"]},
    )


def assigned(robot: Robot, values: np.ndarray, run: Run) -> list[tuple[Assignment, np.ndarray]]:
    """What parameters (n, P) and the settings of as many episodes set, in order, each to (n,) values."""
    settings = run.settings
    if settings is None:
        settings = np.tile([s.nominal for s in robot.file.settings], (len(values), 1))
    out = [(a, values[:, i].copy()) for i, s in enumerate(robot.setters) for a in s]
    out += [(a, settings[:, i].copy()) for i, s in enumerate(robot.setting_setters) for a in s]
    return out


def log_periods(robot: Robot, values: np.ndarray, run: Run) -> np.ndarray:
    """(B, E) seconds from a row of the log to the next, of simulators (B, P) in each episode of a run."""
    shape = len(values), run.episodes
    if run.period is not None:
        return np.full(shape, run.period)
    settings = run.settings if run.settings is None else np.tile(run.settings, (shape[0], 1))
    each = np.repeat(values, run.episodes, axis=0)
    ports = nominal_ports(robot, len(each))
    for assignment, told in assigned(robot, each, replace(run, settings=settings)):
        if (assignment.root, assignment.path) == ("control", "rate"):
            ports.apply(assignment, told)
    return (1.0 / ports.control["rate"]).reshape(shape)


@dataclass(frozen=True)
class ServoLaw:
    """torque = clip(gain u + bias - stiffness q - rate qd, +-limit (1 -+ fade qd)) - damping qd; each (B, A).

    The bounds stay within 0 and +-limit: a motor that turns gives less the faster it does, and never more than at rest.
    """

    gain: np.ndarray
    stiffness: np.ndarray
    rate: np.ndarray
    limit: np.ndarray
    damping: np.ndarray
    bias: np.ndarray
    fade: np.ndarray

    def limited(self, torque: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(B, A) of the torques that the loop asks for, what the drives can give at speeds v."""
        low, high = self.bounds(v) if self.fading else (-self.limit, self.limit)
        return np.minimum(np.maximum(torque, low), high)

    def bounds(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, A), (B, A) least and largest torque at speeds v."""
        slower = self.fade * v
        low, high = (np.minimum(np.maximum(1.0 + s, 0.0), 1.0) for s in (slower, -slower))
        return -self.limit * low, self.limit * high

    @cached_property
    def fading(self) -> bool:
        """Whether any drive gives less torque the faster it turns."""
        return bool((self.fade != 0.0).any())


def servo_law(ports: Ports, inputs: np.ndarray) -> ServoLaw:
    """The law of every drive at one instant, for inputs (B, I) (supply voltages, enable flags)."""
    d = ports.drive
    types = np.array(ports.types)
    if "velocity" in ports.types:
        raise SimulationError(
            f"the drive of action {ports.actions[ports.types.index('velocity')]!r} is of type 'velocity'",
            expected="a drive that becomes a torque: velocity drives are those of the "
            f"{' and '.join(engines_with('planar'))} engines",
            do=f'set engines = ["{engines_with("planar")[0]}"], or correct the drive',
        )
    supply, on = d["supply"], np.True_
    if (ports.supply_input >= 0).any():
        measured = inputs[:, np.maximum(ports.supply_input, 0)]
        supply = np.where(ports.supply_input >= 0, measured, supply)
    if (ports.enable_input >= 0).any():
        on = np.where(ports.enable_input >= 0, inputs[:, np.maximum(ports.enable_input, 0)] >= 0.5, True)
    return law_of(d, {kind: types == kind for kind in TYPES}, ports.sensor, supply, on)


TYPES = ("position", "torque", "duty_servo", "dcmotor", "speed")  # of drives that become a torque


def law_of(
    d: Mapping[str, Any], types: Mapping[str, Any], sensor: Mapping[str, Any], supply: Any, on: Any
) -> ServoLaw:
    """The law by the keys of drives and of their encoders, whether a drive is of each type, its supply, and whether it
    is on; elementwise.
    """
    position, torque, duty, motor, speed = (types[kind] for kind in TYPES)
    back_emf = d["kt"] ** 2 / d["resistance"]
    stall = d["kt"] / d["resistance"]
    duty_stiffness = d["duty_gain"] * d["gain"] * stall * supply
    gain = np.where(duty, duty_stiffness, np.where(motor, stall, np.where(speed, d["rate_gain"], d["gain"])))
    stiffness = np.where(duty, duty_stiffness, np.where(position, d["gain"], 0.0))
    rate = np.where(position | speed, d["rate_gain"], 0.0)
    limit = np.where(duty, stall * np.maximum(supply, 0.0) * d["duty_limit"], d["torque_limit"])
    # what is not stated limits nothing
    limited = position & is_limit(d["torque_limit"]) & is_limit(d["speed_limit"])
    back = d["back_emf"] > 0.5
    damping = np.where(limited & back, d["torque_limit"] / d["speed_limit"], 0.0)
    fade = np.where(limited & ~back, 1.0 / d["speed_limit"], 0.0)
    damping = np.where(duty | motor, back_emf, np.where(torque | speed, 0.0, damping))
    gain, stiffness, rate = (x * d["gain_factor"] for x in (gain, stiffness, rate))
    limit = limit * d["limit_factor"]
    stiffness, rate = stiffness * sensor["scale"], rate * sensor["scale"]
    gain, stiffness, rate, damping = (np.where(on, x, 0.0) for x in (gain, stiffness, rate, damping))
    return ServoLaw(gain, stiffness, rate, limit, damping, -stiffness * sensor["offset"], fade)


def slice_of(numbers: np.ndarray) -> slice | np.ndarray:
    """The same rows or columns as a slice where they are in a row: arrays are cut several times faster so."""
    if len(numbers) and (np.diff(numbers) == 1).all():
        return slice(int(numbers[0]), int(numbers[-1]) + 1)
    return numbers


def takes_positions(ports: Ports) -> np.ndarray:
    """(A,) whether each action is a position that its drive moves to, as against a torque or a voltage."""
    return np.array([t in ("position", "duty_servo") for t in ports.types], dtype=bool)


def largest_speeds(robot: Robot) -> np.ndarray:
    """(A,) largest command of each drive that is told a speed, where its range is stated; else 1."""
    types = nominal_ports(robot, 1).types
    ends = [max(abs(a.low or 0.0), abs(a.high or 0.0)) or 1.0 for a in robot.file.actions]
    return np.array([end if t == "velocity" else 1.0 for end, t in zip(ends, types, strict=True)])


def law_changes(ports: Ports, inputs: np.ndarray) -> frozenset[int]:
    """Numbers of the commands from which on the law is another one (a measured supply or enable channel changed).

    inputs : (n, T, I) of all simulations.
    """
    heard = np.unique([ports.supply_input, ports.enable_input])
    heard = heard[heard >= 0]
    changed = (inputs[:, 1:, heard] != inputs[:, :-1, heard]).any(axis=(0, 2))
    return frozenset((1 + np.flatnonzero(changed)).tolist())


def _drive_of(robot: Robot, joint: str, action: str):
    for table in robot.file.drives:
        if fnmatchcase(joint, table.joint) or fnmatchcase(action, table.joint):
            return table
    raise RobotError(
        f"no drive moves joint {joint!r} of action {action!r}",
        expected=f"a [[drives]] table whose joint matches, not {quoted(t.joint for t in robot.file.drives)}",
        do="add it to robot.toml",
    )

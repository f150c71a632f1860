"""Truths on two wheels, from parameters and a cause to readings."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.rng import stream
from dynreg.truths.arms import coloured
from dynreg.truths.causes import Units
from dynreg.truths.kernels import rolling
from dynreg.truths.rolling import ENDLESS, ROWS, SCALE, SPEED_LAG, YAW_LAG
from dynreg.truths.truth import Commands, Sensor, Truth

STEP = 1e-3  # s
FASTEST = 15.0  # rad/s of a wheel
DISTURBED = 0.005  # of it, 1 sigma, drawn anew for every command: by contract
_ROWS: Mapping[str, Mapping[str, str]] = {
    "wheel_gain": {"difference": "difference"},
    "wheel_slip": {"grip": "grip"},
    "turn_slowdown": {"arm": "arm"},
    "command_delay": {"delay": "delay"},
    "command_lag": {"time": "lag"},
    "command_gain": {"gain": "gain"},
    "command_deadband": {"width": "deadband"},
    "rate_limit": {"rate": "rate_limit"},
    "wheel_creep": {"time": "creep"},
    "second_lag": {"time": "second_lag"},
    "eccentric_wheel": {"error": "eccentric"},
}
CAUSES_OF_WHEELS = (*_ROWS, "drive_inertia", "encoder_scale", "sensor_delay", "coloured_speed")


def rows_of(parameters: Mapping[str, float], causes: Mapping[str, Mapping[str, float]]) -> np.ndarray:
    """(R,) what the equations of `rolling` are told of a robot with causes {id: values}; KeyError for one they lack."""
    x = np.zeros(len(ROWS))
    usual = {"radius": parameters["wheel_radius"], "scale": 1.0, "rate_limit": ENDLESS, "grip": ENDLESS}
    own = {name: parameters[name] for name in ("track", "speed_lag", "yaw_lag", "speed_drag", "yaw_drag")}
    for name, value in (usual | own).items():
        x[ROWS.index(name)] = value
    for cause, values in causes.items():
        if cause == "drive_inertia":
            x[[SPEED_LAG, YAW_LAG]] += values["time"]
        elif cause == "encoder_scale":
            x[SCALE] = 1.0 + values["error"]
        else:
            for name, target in _ROWS[cause].items():
                x[ROWS.index(target)] = values[name]
    return x


@dataclass(frozen=True)
class Wheels:
    """A base on a left and a right wheel."""

    joints: tuple[str, ...]
    units: Units
    sensors: tuple[Sensor, ...]

    def states(self, truth: Truth, commands: Commands) -> np.ndarray:
        """(E, T+1, 7) wheel angles and speeds, x, y and yaw, without noise."""
        inside = truth.cause in (*_ROWS, "drive_inertia", "encoder_scale")
        x = rows_of(truth.parameters, {truth.cause: truth.values} if inside else {})
        shape = commands.actions.shape
        rng = stream(truth.seed, "truth pushes")
        told = commands.actions + (0.0 if truth.exact else DISTURBED * FASTEST) * rng.standard_normal(shape)
        if truth.cause == "coloured_speed":
            told = told + truth.values["speed"] * coloured(rng, shape, commands.period)
        late = truth.values["delay"] if truth.cause == "sensor_delay" else 0.0
        count = round(commands.period / STEP)
        at = np.maximum(np.arange(shape[1] + 1) * count - round(late / STEP), 0)
        out = []
        for e in range(shape[0]):
            begin = np.zeros(7) if commands.initial is None else np.nan_to_num(commands.initial[e])
            trace = np.empty((shape[1] * count + 1, 7))
            rolling().drive(x, np.ascontiguousarray(told[e]), commands.period, count, begin, trace)
            out.append(trace[at])
        return np.stack(out)


WHEELS = Wheels(
    joints=("left_wheel", "right_wheel"),
    units=Units(command=FASTEST),
    sensors=(
        Sensor("left_wheel/position", 0.0005, 0.0022724),
        Sensor("right_wheel/position", 0.0005, 0.0022724),
        Sensor("left_wheel/velocity", 0.03),
        Sensor("right_wheel/velocity", 0.03),
        Sensor("base/x", 0.001),
        Sensor("base/y", 0.001),
        Sensor("base/yaw", 0.0087),
    ),
)

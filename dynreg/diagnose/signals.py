"""The signals of each joint at every command of a log: motion, command, and nominal torque of its drive.

They come from measured rows, commands and the robot's nominal servo law; nothing is simulated.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of
from dynreg.replay.windows import Windows
from dynreg.sim.ports import Ports, assigned, nominal_ports, servo_law, takes_positions
from dynreg.sim.robot import Robot


@dataclass(frozen=True, eq=False)
class JointSignals:
    """One driven joint over W windows of T commands; every array is (W, T), NaN where nothing was measured.

    joint : its name; of a planar base the driven quantity, such as "base/speed".
    position, velocity : as measured when the command was given; the velocity from positions where the log has none.
    command : clipped to the action's range. command_error : command - position (or - velocity), NaN for torques.
    torque : of the drive by the nominal servo law [N m or N]; NaN for drives that follow velocities.
    saturated : whether that law is at its limit. enabled : whether the drive is on.
    velocity_noise : 1 sigma of the velocity by the stated noise and quantum.
    """

    joint: str
    position: np.ndarray
    velocity: np.ndarray
    command: np.ndarray
    command_error: np.ndarray
    torque: np.ndarray
    saturated: np.ndarray
    enabled: np.ndarray
    velocity_noise: float

    @property
    def load(self) -> np.ndarray:
        """(W, T) absolute torque of the drive, or absolute command error if the torque is unknown."""
        return np.abs(self.torque if np.isfinite(self.torque).any() else self.command_error)


def joint_signals(robot: Robot, windows: Windows) -> dict[str, JointSignals]:
    """{joint: its signals} of every driven joint, in the order of the actions."""
    ports = window_ports(robot, windows)
    planar = "velocity" in ports.types
    low, high = robot.action_ranges.T
    commands = np.clip(windows.run.actions, low, high)
    joints = joints_of_actions(robot)
    motions = [motion_of(robot, windows, name) for name in joints]
    if planar:  # of drives that follow velocities no torque is known, and the limit is the command's range
        at_limit = (commands <= low) | (commands >= high)
        drives = np.full(commands.shape, np.nan), at_limit, np.ones(commands.shape, dtype=bool)
    else:
        drives = _torque_drives(robot, windows, ports, commands, motions)
    follows = np.full(len(robot.actions), planar) | takes_positions(ports)
    out: dict[str, JointSignals] = {}
    for a, name in enumerate(joints):
        position, velocity, noise = motions[a]
        followed = velocity if planar else position
        error = commands[..., a] - followed if follows[a] else np.full(followed.shape, np.nan)
        torque, saturated, enabled = (x[..., a] for x in drives)
        signals = JointSignals(
            name, position, velocity, commands[..., a], error, torque, saturated, enabled, noise
        )
        out.setdefault(name, signals)
    return out


def joints_of_actions(robot: Robot) -> list[str]:
    """(A,) what each action drives: its joint (a wheel is one), or the velocity of a planar base that it commands."""
    types = nominal_ports(robot, 1).types
    return [
        name.removesuffix("/velocity_command").removesuffix("_command") if kind == "velocity" else joint
        for name, joint, kind in zip(robot.actions, robot.joints, types, strict=True)
    ]


def joint_of_channel(channel: str, joints: list[str] | dict[str, JointSignals]) -> str | None:
    """The driven joint that a channel belongs to; None for those of a floating base and of passive joints."""
    owner = joint_of(channel)
    return channel if channel in joints else owner if owner in joints else None


def velocity_column(robot: Robot, joint: str) -> int | None:
    """Column of the joint's velocity in the state vector; None where the robot has no such channel."""
    name = joint if "/" in joint else f"{joint}/velocity"
    return robot.channels.index(name) if name in robot.channels else None


def position_column(robot: Robot, joint: str) -> int | None:
    """Column of the joint's position in the state vector; None where the robot has no such channel."""
    name = f"{joint}/position"
    return robot.channels.index(name) if name in robot.channels else None


def motion_of(robot: Robot, windows: Windows, joint: str) -> tuple[np.ndarray, np.ndarray, float]:
    """(W, T) positions and velocities of a joint at the commands, and 1 sigma of the velocities."""
    measured, noise = windows.measured, robot.sensor_noise
    nothing = np.full(measured.shape[:2], np.nan)
    p, v = position_column(robot, joint), velocity_column(robot, joint)
    position = nothing if p is None else measured[..., p]
    slope = np.gradient(position, windows.period, axis=1)
    slope_noise = 0.0 if p is None else noise[p] / (np.sqrt(2) * windows.period)
    if v is None or not np.isfinite(measured[..., v]).any():
        return position[:, :-1], slope[:, :-1], float(slope_noise)
    velocity = np.where(np.isfinite(measured[..., v]), measured[..., v], slope)
    return position[:, :-1], velocity[:, :-1], float(noise[v])


def window_ports(robot: Robot, windows: Windows) -> Ports:
    """Ports of the nominal robot under each window's known settings: W simulators."""
    count = len(windows)
    ports = nominal_ports(robot, count)
    for assignment, column in assigned(robot, robot.space.nominal[None], windows.run):
        if assignment.root == "port":
            ports.apply(assignment, column)
    return ports


def _torque_drives(
    robot: Robot, windows: Windows, ports: Ports, commands: np.ndarray, motions: list[tuple]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(W, T, A) torque by the nominal law, whether it is at its limit, whether the drive is on.

    The torque is NaN for drives with an integral part: what that has gathered before a window is not in the log.
    """
    steps = windows.run.steps
    inputs = windows.run.inputs
    if inputs is None:
        inputs = np.tile(robot.input_defaults, (len(windows), steps, 1))
    flat = inputs.reshape(len(windows) * steps, -1)
    law = servo_law(ports.repeat(steps), flat)
    q, v = (np.stack([m[i] for m in motions], axis=-1).reshape(law.gain.shape) for i in (0, 1))
    # a drive without stiffness needs no position, and one without rate no velocity: NaN must not pass
    asked = law.gain * commands.reshape(law.gain.shape) + law.bias
    asked = (
        asked
        - np.where(law.stiffness == 0, 0.0, law.stiffness * q)
        - np.where(law.rate == 0, 0.0, law.rate * v)
    )
    drag = np.where(law.damping == 0, 0.0, law.damping * v)
    enabled = np.ones(law.gain.shape, dtype=bool)
    if (ports.enable_input >= 0).any():
        flags = flat[:, np.maximum(ports.enable_input, 0)] >= 0.5
        enabled = np.where(ports.enable_input >= 0, flags, True)
    with np.errstate(invalid="ignore"):
        saturated = enabled & (np.abs(asked) >= law.limit * (1 - 1e-9))
    torque = np.where(enabled, np.clip(asked, -law.limit, law.limit) - drag, 0.0)
    torque[:, (ports.drive["integral_gain"] > 0).any(axis=0)] = np.nan
    return tuple(x.reshape(commands.shape) for x in (torque, saturated, enabled))

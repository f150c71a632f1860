"""How a wheeled robot is told to drive and where its base was, as its recordings say it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of, quantity_of
from dynreg.errors import LogError, RobotError
from dynreg.sim.robot import Robot
from dynreg.sim.spec import BaseTable

POSE = ("base/x", "base/y", "base/yaw")
BASE_COMMANDS = ("speed_command", "yaw_rate_command")
TRACK = 2.0  # m: where robot.toml has no [base]; wheels at v - w and v + w tell speed and yaw rate exactly
TURN = 2.0 * np.pi
ROUNDING = 1e-3  # rad that an angle within one turn may lie outside of it
SURE = 0.5 * np.pi  # rad told between two rows: even twice as quick, the base makes less than half a turn


@dataclass(frozen=True)
class Wheels:
    """How a robot is told to drive: columns of a recording, and what makes wheel speeds on the ground of them.

    columns : (2,) of the left and the right wheel [rad/s], or of speed [m/s] and yaw rate [rad/s]. radius : of the
    wheels [m], None for speed and yaw rate. track : between the wheels [m].
    """

    columns: np.ndarray
    radius: float | None
    track: float

    def speeds(self, values: np.ndarray) -> np.ndarray:
        """(T, 2) speeds of the wheels on the ground [m/s], of a recording's rows (T, C)."""
        told = values[:, self.columns]
        if self.radius is not None:
            return self.radius * told
        speed, half = told[:, :1], 0.5 * self.track * told[:, 1:]
        return np.concatenate([speed - half, speed + half], axis=1)

    @property
    def matrix(self) -> np.ndarray:
        """(2, 2) that makes speeds of the wheels on the ground [m/s] of the two commands."""
        if self.radius is not None:
            return self.radius * np.eye(2)
        return np.array([[1.0, -0.5 * self.track], [1.0, 0.5 * self.track]])


def steering(robot: Robot) -> tuple[str, str] | None:
    """The two commands that drive a base: of its wheels, or speed and yaw rate; None for a robot without wheels."""
    base = robot.file.base
    pairs = [tuple(f"{side}/velocity_command" for side in (base.left, base.right))] if base else []
    pairs += [tuple(f"{owner}/{command}" for command in BASE_COMMANDS) for owner in robot.driven]
    return next((pair for pair in pairs if {*pair} <= {*robot.actions}), None)


def wheels_of(robot: Robot, names: Sequence[str]) -> Wheels:
    """How the robot is told to drive, in a recording with channels `names`; raises as `told`."""
    base, pair = robot.file.base, steering(robot)
    if pair is None:
        raise RobotError(
            f"robot {robot.name!r} has no wheels",
            expected="[base] in robot.toml, or actions 'base/speed_command' and 'base/yaw_rate_command'",
            do="name a wheeled robot, such as 'diffdrive'",
        )
    _require(names, pair, "the commands", "log the commands, or map them with --map")
    on_wheels = not pair[0].endswith(BASE_COMMANDS[0])
    return Wheels(
        np.array([names.index(name) for name in pair]),
        base.wheel_radius if on_wheels else None,
        base.track if base else TRACK,
    )


def law_of(base: BaseTable) -> np.ndarray:
    """(6,) what robot.toml says of a base, as parameters of `unicycle`."""
    lags, drags = (base.speed_lag, base.yaw_lag), (base.speed_drag, base.coupling, base.yaw_drag)
    return np.array([*lags, base.centrifugal, *drags])


def pose_names(robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """The channels of the base's x, y and yaw, in a recording with channels `names`; LogError where one is missing."""
    owners = dict.fromkeys(joint_of(name) for name in robot.channels)
    poses = [tuple(f"{owner}/{quantity_of(part)}" for part in POSE) for owner in owners]
    pose = next((pose for pose in poses if {*pose} <= {*robot.channels}), POSE)
    _require(
        names,
        pose,
        "the pose of the base",
        "log it (motion capture, a camera above, odometry), or map it with --map",
    )
    return pose


def _require(names: Sequence[str], needed: Sequence[str], what: str, do: str) -> None:
    missing = [name for name in needed if name not in names]
    if missing:
        raise LogError(
            f"the recording has no channel {missing[0]!r}",
            expected=f"{what}: {', '.join(needed)}",
            do=do,
        )


def within_one_turn(yaw: np.ndarray) -> bool:
    """Whether angles (T,) may have been wrapped: to -pi to pi, or to 0 to 2 pi."""
    known = yaw[np.isfinite(yaw)]
    if not len(known):
        return False
    low, high = known.min() + ROUNDING, known.max() - ROUNDING
    return bool((low >= -np.pi and high <= np.pi) or (low >= 0.0 and high <= TURN))


def unwrapped(time: np.ndarray, yaw: np.ndarray, speeds: np.ndarray, track: float) -> np.ndarray:
    """(T,) angles [rad] without whole turns, of those (T,) within one turn; NaN where none was measured, but one was.

    time : (T,) [s]. speeds : (T, 2) told of the wheels [m/s], `track` [m] apart.
    From one measured row to the next the base turns the shorter way. Only where it was told `SURE` or more in between
    whole turns may hide there, and what was told decides.
    """
    known = np.flatnonzero(np.isfinite(yaw))
    rate = np.nan_to_num((speeds[:-1, 1] - speeds[:-1, 0]) / track)
    told, most = (np.concatenate([[0.0], np.cumsum(r * np.diff(time))]) for r in (rate, np.abs(rate)))
    steps, asked = np.diff(yaw[known]), np.diff(told[known])
    asked = np.where(np.diff(most[known]) < SURE, 0.0, asked)
    out = np.full(len(yaw), np.nan)
    out[known[0]] = yaw[known[0]]
    out[known[1:]] = yaw[known[0]] + np.cumsum(steps + TURN * np.round((asked - steps) / TURN))
    return out

"""Wheeled robots' recordings as timed commands and the displacements that they brought."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError, RobotError
from dynreg.sim.robot import Robot
from dynreg.timed.commands import Commands, displacement
from dynreg.timed.kinematic import kinematic

POSE = ("base/x", "base/y", "base/yaw")
BASE_COMMANDS = ("speed_command", "yaw_rate_command")
TRACK = 2.0  # m: where robot.toml has no [base]; wheels at v - w and v + w tell speed and yaw rate exactly
TURN = 2.0 * np.pi
ROUNDING = 1e-3  # rad that an angle within one turn may lie outside of it


@dataclass(frozen=True, eq=False)
class Told:
    """What a recording tells: n commands, what they moved (n, 3) and the number of the episode of each (n,).

    begin, end : (n,) seconds on the episode's clock. start : (n, 3) measured pose x [m], y [m], yaw [rad] at the begin.
    track : between the wheels [m], of which the commands speak. left_out : commands without a pose at begin or end.
    """

    commands: Commands
    moved: np.ndarray
    episode: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    start: np.ndarray
    track: float
    left_out: int


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


def told(robot: Robot, recording: Recording, *, longest: float = np.inf) -> Told:
    """Commands of a recording, each as long as both wheels were told the same, and what the pose did meanwhile.

    longest : seconds after which a command counts as another. Commands at whose begin or end no pose was measured are
    left out. Speeds are in m/s on the ground, by the nominal wheels of robot.toml. A yaw that is logged within one turn
    is taken to have made the whole turns that the closed form says. Raises RobotError for a robot that is told neither
    the speeds of two wheels of [base] nor those of a base, LogError where commands or pose were not logged, or no
    command has both poses.
    """
    wheels = wheels_of(robot, recording.names)
    columns = [recording.names.index(name) for name in pose_names(robot, recording.names)]
    parts, moves, places, left_out = [], [], [], 0
    for number, episode in enumerate(recording.episodes):
        speeds = wheels.speeds(episode.values)
        begin = _begins(episode.time, speeds, longest)
        end = np.append(begin[1:], len(episode.time) - 1)
        begin, end = begin[end > begin], end[end > begin]
        if not len(begin):
            continue
        left, right = speeds[begin].T
        before = np.concatenate([[[0.0, 0.0]], speeds[begin[:-1]]]).T
        commands = Commands(left, right, episode.time[end] - episode.time[begin], *before)
        poses = episode.values[:, columns]
        moved = displacement(poses[begin], poses[end])
        if _within_one_turn(poses[:, 2]):
            apart = kinematic(commands, wheels.track)[:, 2] - moved[:, 2]
            moved[:, 2] += TURN * np.round(apart / TURN)
        known = np.isfinite(moved).all(axis=1) & np.isfinite(commands.table).all(axis=1)
        left_out += int((~known).sum())
        parts.append(commands.take(known))
        moves.append(moved[known])
        stamps = np.stack([np.full(len(begin), number), episode.time[begin], episode.time[end]], axis=1)
        places.append(np.concatenate([stamps, poses[begin]], axis=1)[known])
    if not sum(map(len, parts)):
        raise LogError(
            "no command has a pose measured at its begin and at its end",
            expected="poses where commands change",
            do="log the pose as often as commands change, or more often",
        )
    whole = [np.concatenate(c) for c in zip(*(p.columns for p in parts), strict=True)]
    place = np.concatenate(places)
    return Told(
        Commands(*whole),
        np.concatenate(moves),
        place[:, 0].astype(int),
        place[:, 1],
        place[:, 2],
        place[:, 3:],
        wheels.track,
        left_out,
    )


def wheels_of(robot: Robot, names: Sequence[str]) -> Wheels:
    """How the robot is told to drive, in a recording with channels `names`; raises as `told`."""
    base = robot.file.base
    pairs = [tuple(f"{side}/velocity_command" for side in (base.left, base.right))] if base else []
    owners = dict.fromkeys(name.rpartition("/")[0] for name in robot.actions)
    pairs += [tuple(f"{owner}/{command}" for command in BASE_COMMANDS) for owner in owners]
    pair = next((pair for pair in pairs if {*pair} <= {*robot.actions}), None)
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


def pose_names(robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """The channels of the base's x, y and yaw, in a recording with channels `names`; LogError where one is missing."""
    owners = dict.fromkeys(name.rpartition("/")[0] for name in robot.channels)
    poses = [tuple(f"{owner}/{part.rpartition('/')[2]}" for part in POSE) for owner in owners]
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


def _within_one_turn(yaw: np.ndarray) -> bool:
    """Whether angles (T,) may have been wrapped: to -pi to pi, or to 0 to 2 pi."""
    known = yaw[np.isfinite(yaw)]
    if not len(known):
        return False
    low, high = known.min() + ROUNDING, known.max() - ROUNDING
    return bool((low >= -np.pi and high <= np.pi) or (low >= 0.0 and high <= TURN))


def _begins(time: np.ndarray, speeds: np.ndarray, longest: float) -> np.ndarray:
    """Rows at which a command begins."""
    begins = [0]
    for row in range(1, len(time) - 1):
        same = np.array_equal(speeds[row], speeds[begins[-1]], equal_nan=True)
        if not same or time[row] - time[begins[-1]] >= longest - 1e-9:
            begins.append(row)
    return np.array(begins)

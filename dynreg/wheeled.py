"""Wheeled robots' recordings as timed commands and the displacements that they brought."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of, quantity_of
from dynreg.data.recording import Recording
from dynreg.errors import LogError, RobotError
from dynreg.sim.robot import Robot
from dynreg.timed.commands import Commands, displacement
from dynreg.timed.unicycle import unicycle

POSE = ("base/x", "base/y", "base/yaw")
BASE_COMMANDS = ("speed_command", "yaw_rate_command")
TRACK = 2.0  # m: where robot.toml has no [base]; wheels at v - w and v + w tell speed and yaw rate exactly
TURN = 2.0 * np.pi
ROUNDING = 1e-3  # rad that an angle within one turn may lie outside of it
SURE = 0.5 * np.pi  # rad told between two rows: even twice as quick, the base makes less than half a turn
EARLY = 0.3  # s of an episode that tell whether it begins with a robot on its way: three times the lag of small ones
APART = 5.0  # standard deviations of a difference of two poses: what noise does not do
LOOSE = 0.1  # of what a base does from standstill that it may do more
STILL = 0.01  # s: shorter lags are none


@dataclass(frozen=True, eq=False)
class Told:
    """What a recording tells: n commands, what they moved (n, 3) and the number of the episode of each (n,).

    begin, end : (n,) seconds on the episode's clock. start : (n, 3) measured pose x [m], y [m], yaw [rad] at the begin.
    track : between the wheels [m], of which the commands speak. left_out : commands without a pose at begin or end.
    on_the_way : episodes whose first command was left out, because the robot moved before it.
    """

    commands: Commands
    moved: np.ndarray
    episode: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    start: np.ndarray
    track: float
    left_out: int
    on_the_way: int = 0


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
    left out. Speeds are in m/s on the ground, by the nominal wheels of robot.toml. The first command of an episode
    begins from standstill; where the first 0.3 s show more than the nominal robot can do from there, nobody knows from
    which speeds, and it is left out. A yaw that is logged within one turn goes the shorter way from row to row; only
    over gaps in which a quarter of a turn or more was told, the way that is nearest to what was told. Raises RobotError
    for a robot that is told neither the speeds of two wheels of [base] nor those of a base, LogError where commands or
    pose were not logged, or no command has both poses.
    """
    wheels = wheels_of(robot, recording.names)
    pose = pose_names(robot, recording.names)
    columns = [recording.names.index(name) for name in pose]
    parts, moves, places, left_out, on_the_way = [], [], [], 0, 0
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
        whole = poses.copy()
        if within_one_turn(poses[:, 2]):
            whole[:, 2] = unwrapped(episode.time, poses[:, 2], speeds, wheels.track)
        moved = displacement(whole[begin], whole[end])
        known = np.isfinite(moved).all(axis=1) & np.isfinite(commands.table).all(axis=1)
        left_out += int((~known).sum())
        if known[0] and _moves_already(
            robot, pose, episode.time[: end[0] + 1], whole, commands, wheels.track
        ):
            known[0] = False
            on_the_way += 1
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
    together = [np.concatenate(c) for c in zip(*(p.columns for p in parts), strict=True)]
    place = np.concatenate(places)
    return Told(
        Commands(*together),
        np.concatenate(moves),
        place[:, 0].astype(int),
        place[:, 1],
        place[:, 2],
        place[:, 3:],
        wheels.track,
        left_out,
        on_the_way,
    )


def wheels_of(robot: Robot, names: Sequence[str]) -> Wheels:
    """How the robot is told to drive, in a recording with channels `names`; raises as `told`."""
    base = robot.file.base
    pairs = [tuple(f"{side}/velocity_command" for side in (base.left, base.right))] if base else []
    pairs += [tuple(f"{owner}/{command}" for command in BASE_COMMANDS) for owner in robot.driven]
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


def _moves_already(
    robot: Robot, pose: Sequence[str], time: np.ndarray, poses: np.ndarray, commands: Commands, track: float
) -> bool:
    """Whether the first poses (T, 3) of an episode show more than a base does that stood before its first command.

    Compared is how far it came ahead and turned by the last pose of the first `EARLY` seconds, of the first command's
    rows at `time` [s], with nothing at all and with what robot.toml says of a base that stood.
    """
    early = np.flatnonzero((time - time[0] <= EARLY) & np.isfinite(poses[: len(time)]).all(axis=1))
    if len(early) < 2:
        return False
    last = early[-1]
    base, seconds, zero = robot.file.base, time[last : last + 1] - time[0], np.zeros(1)
    told = Commands(commands.left[:1], commands.right[:1], seconds, zero, zero)
    law = np.array([STILL, STILL, 0.0, 1.0, 0.0, 1.0])
    if base:
        law[:] = base.speed_lag, base.yaw_lag, base.centrifugal, base.speed_drag, base.coupling, base.yaw_drag
        law[:2] = np.maximum(law[:2], STILL)
    standing = unicycle(told, law, track, step=0.5 * STILL)[0, 1:]
    noise = {c.name: c.noise for c in robot.file.channels}
    sigma = np.array([max(noise[pose[0]], noise[pose[1]]), noise[pose[2]]])
    slack = APART * np.sqrt(2.0) * sigma + LOOSE * np.abs(standing) + ROUNDING
    found = displacement(poses[:1], poses[last : last + 1])[0, 1:]
    low, high = np.minimum(standing, 0.0) - slack, np.maximum(standing, 0.0) + slack
    return bool(((found < low) | (found > high)).any())


def _begins(time: np.ndarray, speeds: np.ndarray, longest: float) -> np.ndarray:
    """Rows at which a command begins."""
    begins = [0]
    for row in range(1, len(time) - 1):
        same = np.array_equal(speeds[row], speeds[begins[-1]], equal_nan=True)
        if not same or time[row] - time[begins[-1]] >= longest - 1e-9:
            begins.append(row)
    return np.array(begins)

"""Wheeled robots' recordings as timed commands and the displacements that they brought."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError, RobotError
from dynreg.sim.robot import Robot
from dynreg.timed.commands import Commands

POSE = ("base/x", "base/y", "base/yaw")


@dataclass(frozen=True, eq=False)
class Told:
    """What a recording tells: n commands, what they moved (n, 3) and the number of the episode of each (n,)."""

    commands: Commands
    moved: np.ndarray
    episode: np.ndarray


def told(robot: Robot, recording: Recording, *, longest: float = np.inf) -> Told:
    """Commands of a recording, each as long as both wheels were told the same, and what the pose did meanwhile.

    longest : seconds after which a command counts as another. Commands at whose begin or end no pose was measured are
    left out. Speeds are in m/s on the ground, by the nominal wheels of robot.toml. Raises RobotError for a robot
    without [base], LogError where no command has both poses.
    """
    base = robot.file.base
    if base is None:
        raise RobotError(
            f"robot {robot.name!r} has no wheels",
            expected="[base] in robot.toml",
            do="name a wheeled robot, such as 'diffdrive'",
        )
    names = [c.name for c in recording.channels]
    missing = [name for name in POSE if name not in names]
    if missing:
        raise LogError(
            f"the recording has no channel {missing[0]!r}",
            expected=f"the pose of the base: {', '.join(POSE)}",
            do="log it (motion capture, a camera above, odometry), or map it with --map",
        )
    columns = [names.index(name) for name in POSE]
    wheels = [names.index(f"{wheel}/velocity_command") for wheel in (base.left, base.right)]
    parts, moves, which = [], [], []
    for number, episode in enumerate(recording.episodes):
        speeds = base.wheel_radius * episode.values[:, wheels]
        begin = _begins(episode.time, speeds, longest)
        end = np.append(begin[1:], len(episode.time) - 1)
        begin, end = begin[end > begin], end[end > begin]
        if not len(begin):
            continue
        left, right = speeds[begin].T
        before = np.concatenate([[[0.0, 0.0]], speeds[begin[:-1]]]).T
        seconds = episode.time[end] - episode.time[begin]
        poses = episode.values[:, columns]
        moved = _displacement(poses[begin], poses[end])
        known = np.isfinite(moved).all(axis=1) & np.isfinite(left + right + before.sum(axis=0))
        parts.append(Commands(left, right, seconds, *before).take(known))
        moves.append(moved[known])
        which.append(np.full(int(known.sum()), number))
    if not sum(map(len, parts)):
        raise LogError(
            "no command has a pose measured at its begin and at its end",
            expected="poses where commands change",
            do="log the pose as often as commands change, or more often",
        )
    whole = [np.concatenate(c) for c in zip(*(p.columns for p in parts), strict=True)]
    return Told(Commands(*whole), np.concatenate(moves), np.concatenate(which))


def _begins(time: np.ndarray, speeds: np.ndarray, longest: float) -> np.ndarray:
    """Rows at which a command begins."""
    begins = [0]
    for row in range(1, len(time) - 1):
        same = np.array_equal(speeds[row], speeds[begins[-1]], equal_nan=True)
        if not same or time[row] - time[begins[-1]] >= longest - 1e-9:
            begins.append(row)
    return np.array(begins)


def _displacement(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n, 3) to the right, ahead and turned, from poses (n, 3) to poses (n, 3); see `commands.AXES`."""
    apart = end - begin
    cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
    right = sin * apart[:, 0] - cos * apart[:, 1]
    ahead = cos * apart[:, 0] + sin * apart[:, 1]
    return np.stack([right, ahead, apart[:, 2]], axis=1)

"""Wheeled robots' recordings as timed commands and the displacements that they brought."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import LogError
from dynreg.sim.robot import Robot
from dynreg.timed.commands import Commands, displacement
from dynreg.timed.unicycle import unicycle
from dynreg.timed.wheels import ROUNDING, Wheels, law_of, pose_names, unwrapped, wheels_of, within_one_turn

EARLY = 0.3  # s of an episode that tell whether it begins with a robot on its way: three times the lag of small ones
APART = 5.0  # standard deviations of a difference of two poses: what noise does not do
LOOSE = 0.1  # of what a base does from standstill that it may do more
STILL = 0.01  # s: shorter lags are none
SAME = 1e-6  # s between the end of one command and the begin of the next


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

    @property
    def follows(self) -> np.ndarray:
        """(n,) whether a command begins where the one before it ends, in the same episode; the first follows none."""
        same = self.episode[1:] == self.episode[:-1]
        out = np.zeros(len(self.episode), dtype=bool)
        out[1:] = same & (np.abs(self.begin[1:] - self.end[:-1]) <= SAME)
        return out


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
    parts = [_of_episode(robot, recording, n, wheels, pose, longest) for n in range(len(recording.episodes))]
    if not any(len(part.moved) for part in parts):
        raise LogError(
            "no command has a pose measured at its begin and at its end",
            expected="poses where commands change",
            do="log the pose as often as commands change, or more often",
        )
    together = lambda *of: np.concatenate(of)  # noqa: E731
    return Told(
        Commands(*map(together, *(p.commands.columns for p in parts))),
        *map(together, *((p.moved, p.episode, p.begin, p.end, p.start) for p in parts)),
        wheels.track,
        sum(p.left_out for p in parts),
        sum(p.on_the_way for p in parts),
    )


def _of_episode(
    robot: Robot, recording: Recording, number: int, wheels: Wheels, pose: Sequence[str], longest: float
) -> Told:
    """What one episode tells; nothing where it has no two rows."""
    episode = recording.episodes[number]
    time, speeds = episode.time, wheels.speeds(episode.values)
    poses = episode.values[:, recording.columns(pose)]
    whole = poses.copy()
    if within_one_turn(poses[:, 2]):
        whole[:, 2] = unwrapped(time, poses[:, 2], speeds, wheels.track)
    begin = _begins(time, speeds, longest)
    end = np.append(begin[1:], len(time) - 1)
    begin, end = begin[end > begin], end[end > begin]
    left, right = speeds[begin].T
    before = np.concatenate([[[0.0, 0.0]], speeds[begin[:-1]]])[: len(begin)].T
    commands = Commands(left, right, time[end] - time[begin], *before)
    moved = displacement(whole[begin], whole[end])
    known = np.isfinite(moved).all(axis=1) & np.isfinite(commands.table).all(axis=1)
    left_out = int((~known).sum())
    already = bool(known[:1].any()) and _moves_already(
        robot, pose, time[: end[0] + 1], whole, commands, wheels.track
    )
    if already:
        known[0] = False
    return Told(
        commands.take(known),
        moved[known],
        np.full(known.sum(), number),
        time[begin][known],
        time[end][known],
        poses[begin][known],
        wheels.track,
        left_out,
        int(already),
    )


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
    law = law_of(base) if base else np.array([STILL, STILL, 0.0, 1.0, 0.0, 1.0])
    law[:2] = np.maximum(law[:2], STILL)
    standing = unicycle(told, law, track, step=0.5 * STILL)[0, 1:]
    noise = {c.name: c.noise for c in robot.file.channels}
    sigma = np.array([max(noise[pose[0]], noise[pose[1]]), noise[pose[2]]])
    slack = APART * np.sqrt(2.0) * sigma + LOOSE * np.abs(standing) + ROUNDING
    found = displacement(poses[:1], poses[last : last + 1])[0, 1:]
    low, high = np.minimum(standing, 0.0) - slack, np.maximum(standing, 0.0) + slack
    return bool(((found < low) | (found > high)).any())


def _begins(time: np.ndarray, speeds: np.ndarray, longest: float) -> np.ndarray:
    """Rows at which a command begins, of times (T,) that increase and speeds (T, 2)."""
    same = (speeds[1:] == speeds[:-1]) | (np.isnan(speeds[1:]) & np.isnan(speeds[:-1]))
    changes = np.flatnonzero(~same.all(axis=1)) + 1
    begins = [0]
    for change in (*changes[changes < len(time) - 1].tolist(), len(time) - 1):
        while True:  # what lasts too long begins again
            last = begins[-1]
            until = min(change, int(np.searchsorted(time, time[last] + longest, side="right")) + 1)
            late = np.flatnonzero(time[last + 1 : until] - time[last] >= longest - 1e-9)
            if not len(late):
                break
            begins.append(last + 1 + int(late[0]))
        begins.append(change)
    return np.array(begins[:-1])

"""A user's robot as one to be tried on: what it did is read from the log of the trial."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.recording import Episode, Recording
from dynreg.errors import LogError
from dynreg.gait.beside import ATTITUDE, base_of, commands_of, measured
from dynreg.gait.runs import Motion
from dynreg.sim.engines.arena import has_fallen
from dynreg.sim.layout import BASE, layout_of
from dynreg.sim.real import Budget, RealRobot, RealTrial, Spent
from dynreg.sim.robot import Robot
from dynreg.sim.run import Walk

LIKE = 0.5  # of the commands' own scatter, by which those of a log may miss them: by contract
WHOLE = 0.9  # of a trial that its log must hold, or the robot was stopped before the end: by contract


@dataclass
class LoggedRobot(RealRobot):
    """A robot that a user's own program moves.

    played : is called with commands (T, A), how many a second, and the trial's name; it plays them, and returns the
    log, with the robot's channels and actions.
    """

    robot: Robot
    played: Callable[[np.ndarray, float, str], Recording]
    budget: Budget = Budget()
    spent: Spent = field(default_factory=Spent)

    def play(self, actions: np.ndarray, rate: float, name: str) -> RealTrial:
        """Raises LogError where the log does not hold these commands, or does not tell how the base moved."""
        recording = self.played(actions, rate, name)
        return RealTrial(recording, walk_of(self.robot, recording, actions, rate))


def walk_of(robot: Robot, recording: Recording, actions: np.ndarray, rate: float) -> Walk:
    """How a robot moved by its log while it was told commands (T, A), `rate` a second; one simulator, one episode.

    The log may begin before the commands and end after them. Where it holds less than `WHOLE` of them, the robot
    counts as fallen at its end: it was stopped. Its places are counted from where the trial began. Raises LogError
    where the log does not hold these commands, or does not tell how the base moved.
    """
    episode, begin = _found(robot, recording, actions, rate)
    _require_base(robot, recording)
    motion = measured(robot, recording, _from(episode, begin), _start(robot))
    steps = len(actions)
    times = np.arange(steps + 1) / rate
    known = np.isfinite(motion.position).all(axis=1) & np.isfinite(motion.attitude).all(axis=1)
    angles = Rotation.from_quat(motion.attitude[known]).as_euler("ZYX")[:, ::-1]
    pose = np.concatenate([motion.position[known], np.unwrap(angles, axis=0)], axis=1)
    base = np.full((steps + 1, len(BASE)), np.nan)
    base[:, :6] = np.stack([np.interp(times, motion.times[known], c) for c in pose.T], axis=1)
    ends = int(motion.times[known][-1] * rate + 1e-6)
    attitude = Rotation.from_euler("ZYX", base[:, 5:2:-1]).as_quat(scalar_first=True)
    fallen = np.flatnonzero(has_fallen(robot, np.concatenate([base[:, :3], attitude], axis=1))[: ends + 1])
    stopped = ends + 1 if ends < WHOLE * steps else steps + 1
    fell = int(min([*fallen[:1], stopped]))
    base[max(fell, 1) :] = base[max(fell, 1) - 1]  # it stays where it was before a fall
    return Walk(base[None, None], np.array([[fell]]), 0)


def _found(robot: Robot, recording: Recording, actions: np.ndarray, rate: float) -> tuple[Episode, float]:
    """The episode that holds these commands best, and the time [s] at which they begin there."""
    best: tuple[float, Episode, float] | None = None
    for episode in recording.episodes:
        logged = commands_of(robot, recording, episode)
        grid = np.arange(int((episode.time[-1] - episode.time[0]) * rate + 1e-6) + 1) / rate
        row = np.searchsorted(episode.time - episode.time[0], grid + 0.5 / rate, side="right") - 1
        logged = logged[np.clip(row, 0, len(logged) - 1)]
        for first in range(max(len(logged) - len(actions) // 2, 1)):
            told = logged[first : first + len(actions)]
            missed = float(np.sqrt(np.mean((told - actions[: len(told)]) ** 2)))
            if best is None or missed < best[0]:
                best = missed, episode, episode.time[0] + grid[first]
    missed, episode, begin = best
    scatter = float(np.sqrt(actions.var(axis=0).mean()))
    if missed > LIKE * scatter:
        raise LogError(
            f"the log's commands differ by {missed:.3g} rad (root mean square) from those of the trial",
            expected=f"less than {LIKE * scatter:.3g} rad, half of what the commands scatter",
            do="give the log of this trial, with the commands that were played",
        )
    return episode, begin


def _start(robot: Robot) -> Motion:
    """The robot at rest, where the model has it."""
    model, at = robot.model, layout_of(robot).base_qpos
    pose = (model.qpos0 if robot.keyframe < 0 else model.key_qpos[robot.keyframe])[at : at + 7]
    return Motion(np.zeros(1), np.empty((1, 0)), pose[None, :3], np.roll(pose[3:], -1)[None])


def _from(episode: Episode, begin: float) -> Episode:
    rows = np.flatnonzero(episode.time >= begin - 1e-6)
    return replace(episode, time=episode.time[rows], values=episode.values[rows])


def _require_base(robot: Robot, recording: Recording) -> None:
    """LogError where a log does not tell how the base turned and moved over the ground."""
    owner = base_of(robot)
    have = {name for name in (*BASE[:2], *BASE[6:8], *ATTITUDE) if f"{owner}/{name}" in recording.names}
    if not ({*ATTITUDE} <= have and ({"x", "y"} <= have or {"vx", "vy"} <= have)):
        raise LogError(
            f"the log does not tell how far {robot.name!r} walked: it has "
            + (", ".join(f"{owner}/{name}" for name in sorted(have)) or f"nothing of {owner!r}"),
            expected=f"{owner}/roll, pitch and yaw, and {owner}/x and y or {owner}/vx and vy",
            do="log these too (a camera or an odometry tells them), and map them",
        )

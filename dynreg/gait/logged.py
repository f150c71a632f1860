"""A user's robot as one to be tried on: what it did is read from the log of the trial."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dynreg.data.recording import Episode, Recording
from dynreg.data.topics import Motion
from dynreg.errors import LogError
from dynreg.gait.beside import ATTITUDE, base_of, commands_of, measured
from dynreg.sim.engines import Arena
from dynreg.sim.engines.arena import has_fallen
from dynreg.sim.excitation import reset_pose
from dynreg.sim.layout import BASE, continued, layout_of
from dynreg.sim.real import RealRobot, RealTrial
from dynreg.sim.robot import Robot, require_commands
from dynreg.sim.run import Run, Walk

# By contract. SAME : of the movement commanded, by which the commands of its log may differ. STILL : of their speed, at
# which a robot that was stopped may go back to rest. WHOLE : of a trial that its log must reach, or it was stopped, and
# hold. LATE : of the usual time between two rows, after which nothing tells the command.
SAME, STILL, WHOLE, LATE = 0.1, 0.2, 0.9, 1.5
ON_TIME = 0.01  # weight of commands that come one early or late: it tells the begin to the step


@dataclass
class LoggedRobot(RealRobot):
    """A robot that a user's own program moves.

    played : is called with commands (T, A), how many a second, and the trial's name; it plays them, and returns the
    log, with the robot's channels and actions. No log tells where a ball went.
    """

    tracks = False

    played: Callable[[np.ndarray, float, str], Recording]

    def play(self, actions: np.ndarray, rate: float, name: str) -> RealTrial:
        """The trial, as its log tells it; raises as `trial_of`."""
        return trial_of(self.robot, self.played(actions, rate, name), actions, rate)


def trial_of(robot: Robot, log: Recording, actions: np.ndarray, rate: float) -> RealTrial:
    """The trial that a log holds, from the first of the commands (T, A), `rate` a second, to the last or the fall.

    The log may begin before that and end after it. Where it ends before `WHOLE` of the commands, the robot counts as
    fallen then: somebody stopped it. A log that was cut at gaps is read across them. The base begins where the settled
    nominal simulator has it, and looks ahead. The log's heights tell how it rises and sinks from there: a camera's zero
    need not be the ground. Its velocities are NaN where the log does not tell them. Raises LogError where the log does
    not hold these commands, is silent for too long, at its end too, or does not tell how the base moved.
    """
    pieces = _found(robot, log, actions, rate)
    found = _as_one(pieces)
    _require_base(robot, log)
    motion = measured(robot, log, found, _start(robot, rate))
    known = np.isfinite(motion.position).all(axis=1) & np.isfinite(motion.attitude).all(axis=1)
    if known.sum() < 2:
        raise LogError(
            f"the log tells the base's place and attitude in {known.sum()} of {len(known)} rows of the trial",
            expected="2 or more, with roll, pitch, yaw and x, y (or vx, vy) in each",
            do="log these at the rate of the commands",
        )
    steps, times = len(actions), np.arange(len(actions) + 1) / rate
    angles = continued(Rotation.from_quat(motion.attitude[known]).as_euler("ZYX")[:, ::-1], axis=0)
    pose = np.concatenate([motion.position[known], angles], axis=1)
    base = np.full((steps + 1, len(BASE)), np.nan)
    base[:, :6] = np.stack([np.interp(times, motion.times[known], c) for c in pose.T], axis=1)
    for i, name in enumerate(BASE[6:], start=6):
        base[:, i] = _velocity(log, found, f"{base_of(robot)}/{name}", times)
    ends = int(motion.times[-1] * rate + 1e-6)
    attitude = Rotation.from_euler("ZYX", base[:, 5:2:-1]).as_quat(scalar_first=True)
    fallen = np.flatnonzero(has_fallen(robot, np.concatenate([base[:, :3], attitude], axis=1)))
    stopped = ends + 1 if ends < WHOLE * steps else steps + 1
    fell = max(int(min([*fallen[:1], stopped])), 1)
    base[fell:] = base[fell - 1]  # it stays where it was before a fall
    end = min(fell, steps) / rate
    _require_told(pieces, known, end, steps / rate)
    part = _between(pieces, found.time[0], found.time[0] + end)
    return RealTrial(replace(log, episodes=part), Walk(base[None, None], np.array([[fell]]), 0))


def _found(robot: Robot, log: Recording, actions: np.ndarray, rate: float) -> tuple[Episode, ...]:
    """The rows of a log in which these commands were played: those that explain most of the movement that was logged.

    A command may come one early or late. LogError where there are no such rows, or where others follow: somebody who
    stops a robot holds it, or lets it rest.
    """
    near = np.stack([np.roll(actions, by, axis=0) for by in (-1, 0, 1)])
    near[0, -1], near[2, 0] = actions[-1], actions[0]
    require_commands(robot, log)
    best, columns = None, log.columns(robot.actions)
    chains = _chained(log.episodes, len(actions) / rate)
    holding = [c for c in chains if np.isfinite(_as_one(c).values[:, columns]).any(axis=0).all()]
    for chain in holding or chains:  # where none holds commands, the first one says so
        grid, logged, there = _told(robot, log, _as_one(chain), rate)
        for first in np.flatnonzero(there):
            told, seen = logged[first : first + len(actions)], there[first : first + len(actions)]
            moved = ((told - actions[0]) ** 2).sum(axis=1)
            missed = ((told - near[:, : len(told)]) ** 2).sum(axis=2)
            gained = SAME**2 * moved - missed.min(axis=0) - ON_TIME * missed[1]
            explained = np.where(seen, np.cumsum(np.where(seen, gained, 0.0)), -np.inf)
            many = len(told) - int(np.argmax(explained[::-1]))
            if best is None or explained[many - 1] > best[0]:
                after = told[many:][np.logical_and.accumulate(seen[many:])]
                best = explained[many - 1], chain, grid[first], grid[first + many - 1], after
    explained, chain, begin, end, after = best
    moves = lambda a: float((np.diff(a, axis=0) ** 2).sum(axis=1).mean()) if len(a) > 1 else 0.0  # noqa: E731
    others = np.sqrt(moves(after) / moves(actions)) if explained > 0.0 else 0.0
    if explained <= 0.0 or others > STILL:
        what = f"are those of the trial for {end - begin:.2g} s alone, then others"
        raise LogError(
            f"the log's commands {what if explained > 0.0 else 'hold nothing of those of the trial'}",
            expected=f"those of the trial for {len(actions) / rate:.3g} s, or the robot stopped",
            do="give the log of this trial, with the commands that were played",
        )
    start = chain[0].time[0]
    return _between(chain, start + begin, start + end + 1.0 / rate)


def _told(
    robot: Robot, log: Recording, episode: Episode, rate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,) [s] from the first row on, `rate` a second; the commands then (T, A); (T,) whether they are told."""
    since = episode.time - episode.time[0]
    grid = np.arange(int(since[-1] * rate + 1e-6) + 1) / rate
    row = np.searchsorted(since, grid + 0.5 / rate, side="right") - 1
    usual = max(float(np.median(np.diff(since))), 1.0 / rate) if len(since) > 1 else 1.0 / rate
    return grid, commands_of(robot, log, episode)[row], grid - since[row] < LATE * usual


def _chained(episodes: Sequence[Episode], longest: float) -> list[tuple[Episode, ...]]:
    """Episodes; those that go on after less than `longest` [s] together, in which a trial may lie across a gap."""
    out: list[tuple[Episode, ...]] = []
    for one in episodes:
        goes_on = out and 0.0 < one.time[0] - out[-1][-1].time[-1] < longest
        out = [*out[:-1], (*out[-1], one)] if goes_on else [*out, (one,)]
    return out


def _as_one(pieces: Sequence[Episode]) -> Episode:
    """Episodes that follow each other, as one with gaps."""
    time, values = (np.concatenate([getattr(one, of) for one in pieces]) for of in ("time", "values"))
    return replace(pieces[0], time=time, values=values)


def _between(pieces: Sequence[Episode], begin: float, end: float) -> tuple[Episode, ...]:
    """The rows of episodes from `begin` to `end` [s]; those without any are left out."""
    rows = [(one.time >= begin - 1e-6) & (one.time <= end + 1e-6) for one in pieces]
    return tuple(
        replace(one, time=one.time[kept], values=one.values[kept])
        for one, kept in zip(pieces, rows, strict=True)
        if kept.any()
    )


def _require_told(pieces: Sequence[Episode], known: np.ndarray, end: float, seconds: float) -> None:
    """LogError where the base is lost, or nothing is logged, for more of a trial of so many seconds than it may lack.

    known : (T,) rows of the pieces that tell the base's pose. end : of what counts [s], from the first row on.
    """
    piece, times = np.repeat(np.arange(len(pieces)), [len(one.time) for one in pieces]), _as_one(pieces).time
    told = known[1:] & (np.diff(piece) == 0)
    lost = np.diff(times)[~told & (times[1:] - times[0] <= end + 1e-6)].sum()
    if lost > (1.0 - WHOLE) * seconds:
        raise LogError(
            f"the log is silent for {lost:.2g} s of the trial about the base's place and attitude",
            expected=f"{(1.0 - WHOLE) * seconds:.2g} s at most, of {seconds:.3g} s",
            do="give a log that holds more of it, or try this gait once more with a logger that keeps up",
        )


def _start(robot: Robot, rate: float) -> Motion:
    """The base at rest, as the nominal simulator settles it: a keyframe may have it in the air or in the ground."""
    rest, at = Run(reset_pose(robot)[None, None], period=1.0 / rate), layout_of(robot).base_qpos
    pose = Arena(robot, robot.space.nominal[None], rest, threads=1).poses(rest)[0, 0, 0, at : at + 7]
    return Motion(np.zeros(1), np.empty((1, 0)), pose[None, :3], np.roll(pose[3:], -1)[None])


def _velocity(log: Recording, episode: Episode, name: str, times: np.ndarray) -> np.ndarray:
    """(T,) a channel at times [s] from the episode's first row on; NaN where it is not logged."""
    values = (
        episode.values[:, log.names.index(name)] if name in log.names else np.full(len(episode.time), np.nan)
    )
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(times), np.nan)
    return np.interp(times, episode.time[known] - episode.time[0], values[known])


def _require_base(robot: Robot, log: Recording) -> None:
    """LogError where a log does not tell how the base turned and moved over the ground."""
    owner = base_of(robot)
    have = {name for name in (*BASE[:2], *BASE[6:8], *ATTITUDE) if f"{owner}/{name}" in log.names}
    if not ({*ATTITUDE} <= have and ({"x", "y"} <= have or {"vx", "vy"} <= have)):
        told = ", ".join(f"{owner}/{name}" for name in sorted(have)) or f"nothing of {owner!r}"
        raise LogError(
            f"the log does not tell how far {robot.name!r} walked: it has {told}",
            expected=f"{owner}/roll, pitch and yaw, and {owner}/x and y or {owner}/vx and vy",
            do="log them (a camera or an odometry tells them), make them [[channels]] of robot.toml, and map them",
        )

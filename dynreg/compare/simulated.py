"""A simulator's answer to timed commands: it replays the whole recording once, and its pose is read at every command.

So its memory is right: a lag, a delay or wheels that still turn reach from one command into the next.
"""

import time
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import LogError, RobotError, SimulationError
from dynreg.replay.cut import windows
from dynreg.replay.timed import EVEN, grid
from dynreg.replay.windows import Windows
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, require_commands
from dynreg.timed.commands import displacement
from dynreg.timed.told import Told
from dynreg.timed.wheels import pose_names

START = 0.1  # s: as long as the quickest bases take to follow; a speed that is seen later is another one


@dataclass(frozen=True, eq=False)
class Replayed:
    """A simulator's poses over a recording.

    told : the recording's commands. poses : {episode number: (time (T,) [s], pose (T, 3) [m, m, rad])}.
    seconds : wall time of the replay.
    """

    told: Told
    poses: dict[int, tuple[np.ndarray, np.ndarray]]
    seconds: float

    def moved(self, which: np.ndarray, share: float = 1.0) -> np.ndarray:
        """(m, 3) displacements of some commands (indexes) after a share of their time, in the simulator's own frame."""
        told = self.told
        begin = told.begin[which]
        end = begin + share * (told.end[which] - begin)
        return displacement(self._at(which, begin), self._at(which, end))

    def _at(self, which: np.ndarray, times: np.ndarray) -> np.ndarray:
        out = np.empty((len(which), 3))
        for number in np.unique(self.told.episode[which]):
            mine = self.told.episode[which] == number
            stamps, poses = self.poses[number]
            out[mine] = np.stack([np.interp(times[mine], stamps, axis) for axis in poses.T], axis=1)
        return out


def replayed(
    robot: Robot, config: SimConfig, name: str, recording: Recording, told: Told, *, threads: int = 0
) -> Replayed:
    """Replay every episode of a recording in a simulator, from the first row to the last, without motor noise.

    robot : the simulator's. Raises LogError where the recording lacks its commands, RobotError where the robot has no
    pose, SimulationError where the simulation diverges.
    """
    require_commands(robot, recording)
    try:
        pose = pose_names(robot, robot.channels)
    except LogError:
        raise RobotError(
            f"simulator {name!r} is of robot {robot.name!r}, which has no pose of a base",
            expected="channels such as 'base/x', 'base/y' and 'base/yaw'",
            do="name a simulator of a wheeled robot",
        ) from None
    began = time.perf_counter()
    even = evenly(robot, recording)
    cut = windows(robot, even, horizon=np.inf)
    values = robot.space.from_dict(dict(config.values))[None]
    states = rollout(robot, values, cut.run, threads=threads, terms=terms_of(config, robot)).states[0]
    poses = _poses(robot, even, cut, states, pose)
    out = Replayed(told, poses, time.perf_counter() - began)
    if {*told.episode.tolist()} - {*poses} or not np.isfinite(out.moved(np.arange(len(told.episode)))).all():
        raise SimulationError(
            f"simulator {name!r} diverges on this recording",
            expected="a pose at every command",
            do="leave it out, or look at its parameters with `dynreg show`",
        )
    return out


def evenly(robot: Robot, recording: Recording) -> Recording:
    """The recording as an engine of `robot` can replay it: the robot's channels, rows evenly in time, a known start.

    Where rows come unevenly, each with the commands that hold from then on, they are put on a grid of the engine's time
    step: a command begins up to half of it early or late. A channel that the first row lacks starts with its first
    value of the first 0.1 s, and is NaN where there is none: the engine then starts as it does without that channel.
    Channels that the recording lacks are NaN.
    """
    gaps = np.concatenate([np.diff(e.time) for e in recording.episodes])
    period = float(np.median(gaps)) if len(gaps) else 0.0
    if not period > 0:
        raise LogError(
            "the recording has one row an episode",
            expected="commands and the states after them",
            do="record longer",
        )
    uneven = bool((np.abs(gaps - period) > EVEN * period).any())
    step = robot.file.robot.timestep
    extra = [name for name in (*robot.actions, *robot.inputs) if name in recording.names]
    names = tuple(dict.fromkeys([*robot.channels, *extra]))
    logged = [column for column, name in enumerate(names) if name in recording.names]
    source = recording.columns([names[column] for column in logged])
    units = {c.name: c.unit for c in (*robot.file.channels, *recording.channels)}
    episodes = []
    for e in recording.episodes:
        values = np.full((len(e.time), len(names)), np.nan)
        values[:, logged] = e.values[:, source]
        early = e.time - e.time[0] <= START * (1.0 + EVEN)
        states = values[early, : len(robot.channels)]
        first = np.isfinite(states).argmax(axis=0)  # row of the first number; any, where there is none
        begin = np.take_along_axis(states, first[None], axis=0)[0]
        stamps = e.time
        if uneven:
            stamps, row = grid(e.time, step)
            values = values[row]
        values[0, : len(robot.channels)] = np.where(np.isfinite(begin), begin, np.nan)
        episodes.append(Episode(e.name, stamps, values, e.settings))
    return Recording(tuple(Channel(n, units[n]) for n in names), tuple(episodes), recording.measured)


def _poses(
    robot: Robot, even: Recording, cut: Windows, states: np.ndarray, pose: tuple[str, ...]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Poses of states (W, T+1, S), a window for each episode that moves."""
    columns = [robot.channels.index(name) for name in pose]
    out = {}
    for number, (start, stop), rows in zip(cut.episode, cut.rows, states, strict=True):
        found = rows[: stop - start, columns].copy()
        found[:, 2] = np.unwrap(found[:, 2])  # some engines tell an angle within one turn
        out[int(number)] = (even.episodes[number].time[start:stop], found)
    return out

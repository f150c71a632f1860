"""Recordings of robots whose commands carry their own duration, as engines replay them: on a grid of time steps."""

from dataclasses import replace

import numpy as np

from dynreg.data.recording import Episode, Recording
from dynreg.replay.velocity import pose_columns
from dynreg.sim.robot import Robot
from dynreg.timed.wheels import unwrapped, wheels_of, within_one_turn

EVEN = 0.01  # of a step that a row may come early or late


def grid(time: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """(G,) stamps a `step` [s] apart from the first of `time` (T,) to the last, and the row that holds at each (G,).

    A row holds from the stamp nearest to it on: its commands begin up to half a step early or late.
    """
    stamps = time[0] + step * np.arange(int(np.ceil((time[-1] - time[0]) / step - EVEN)) + 1)
    row = np.searchsorted(time, stamps + 0.5 * step, side="right") - 1
    return stamps, np.clip(row, 0, len(time) - 1)


def on_grid(robot: Robot, recording: Recording) -> Recording:
    """The recording with rows at every time step of `robot`; as it is where commands come at a fixed rate.

    Each row's commands hold until the next (`grid`). States stand at the row nearest to when they were measured, NaN at
    the others: nothing between them is made up. A yaw of a planar base that is logged within one turn is followed
    through whole turns, by what was told in between. Raises as `wheels_of`.
    """
    if robot.file.robot.control != "timed":
        return recording
    step = robot.file.robot.timestep
    measured = np.array([name in robot.channels for name in recording.names])
    episodes = []
    for e in recording.episodes:
        stamps, row = grid(e.time, step)
        values = e.values[row]
        values[:, measured] = np.nan
        at = np.clip(np.round((e.time - e.time[0]) / step).astype(int), 0, len(stamps) - 1)
        values[np.ix_(at, measured)] = _whole_turns(robot, recording, e).values[:, measured]
        episodes.append(Episode(e.name, stamps, values, e.settings))
    return Recording(recording.channels, tuple(episodes), recording.measured, recording.provenance)


def _whole_turns(robot: Robot, recording: Recording, episode: Episode) -> Episode:
    pose = pose_columns(robot)
    if pose is None or robot.channels[pose[2]] not in recording.names:
        return episode
    yaw = recording.names.index(robot.channels[pose[2]])
    if not within_one_turn(episode.values[:, yaw]):
        return episode
    wheels, values = wheels_of(robot, recording.names), episode.values.copy()
    told = values.copy()
    told[:, wheels.columns] = held(values[:, wheels.columns], np.zeros(len(wheels.columns)))
    values[:, yaw] = unwrapped(episode.time, values[:, yaw], wheels.speeds(told), wheels.track)
    return replace(episode, values=values)


def held(values: np.ndarray, before: np.ndarray) -> np.ndarray:
    """(T, A) commands with NaN replaced by the last one before it, or by `before` (A,) where there was none."""
    at = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    values = np.take_along_axis(values, np.maximum.accumulate(at, axis=0), axis=0)
    return np.where(np.isfinite(values), values, before)

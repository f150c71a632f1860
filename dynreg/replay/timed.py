"""Recordings of robots whose commands carry their own duration, as engines replay them: on a grid of time steps."""

import numpy as np

from dynreg.data.recording import Episode, Recording
from dynreg.sim.robot import Robot


def on_grid(robot: Robot, recording: Recording) -> Recording:
    """The recording with rows at every time step of `robot`; as it is where commands come at a fixed rate.

    Each row's commands hold until the next; a command begins up to half a time step early or late. States stand at the
    row nearest to when they were measured, NaN at the others: nothing between them is made up.
    """
    if robot.file.robot.control != "timed":
        return recording
    step = robot.file.robot.timestep
    measured = np.array([name in robot.channels for name in recording.names])
    episodes = []
    for e in recording.episodes:
        stamps = e.time[0] + step * np.arange(int(np.round(e.duration / step)) + 1)
        row = np.searchsorted(e.time, stamps + 0.5 * step, side="right") - 1
        values = e.values[np.clip(row, 0, len(e.time) - 1)].copy()
        values[:, measured] = np.nan
        at = np.clip(np.round((e.time - e.time[0]) / step).astype(int), 0, len(stamps) - 1)
        values[np.ix_(at, measured)] = e.values[:, measured]
        episodes.append(Episode(e.name, stamps, values, e.settings))
    return Recording(recording.channels, tuple(episodes), recording.measured, recording.provenance)

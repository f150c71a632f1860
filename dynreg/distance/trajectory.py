"""Trajectory distance: the recording against each entry's stored run of the same commands."""

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.errors import UsageError


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by this distance; needs their states. Raises as `trajectory`."""
    recording, robot, states = asked.recording, asked.robot, asked.population.entries.states
    some = [episode.values for episode in recording.episodes]
    rows = min(len(values) for values in some)
    measured = np.stack([values[:rows, recording.columns(robot.channels)] for values in some])
    commands = np.stack([values[: rows - 1, recording.columns(robot.actions)] for values in some])
    spread = states.reshape(-1, states.shape[-1]).std(axis=0) + 1e-9
    every = trajectory(states, asked.population.shared.run.actions, measured, commands, spread)
    return in_order(asked.allowed, every[asked.allowed], len(every))


def trajectory(
    states: np.ndarray, actions: np.ndarray, measured: np.ndarray, commands: np.ndarray, spread: np.ndarray
) -> np.ndarray:
    """(M,) mean absolute difference, in units of each channel's spread.

    Parameters
    ----------
    states : (M, E, T+1, S) what the entries did under the bank's commands.
    actions : (E, T, A) the bank's commands.
    measured : (E', T'+1, S) what the robot did; commands : (E', T', A) what it was told.
    spread : (S,) unit of each channel.

    Raises UsageError where an episode's commands are none of the bank's.
    """
    steps = min(commands.shape[1], actions.shape[1])
    total = np.zeros(len(states))
    for episode in range(len(commands)):
        apart = np.abs(actions[:, :steps] - commands[episode, :steps]).max(axis=(1, 2))
        match = int(np.argmin(apart))
        if not apart[match] <= 1e-3 * max(np.ptp(actions), 1e-12):  # NaN is no match either
            raise UsageError(
                f"episode {episode} of the recording ran commands that the population did not",
                expected="the population's own command bank on the robot",
                do="use --distance one_sided, or run the bank's commands on the robot",
            )
        difference = states[:, match, : steps + 1] - measured[episode, : steps + 1]
        total += np.nanmean(np.abs(difference) / spread, axis=(1, 2))
    return total / len(commands)

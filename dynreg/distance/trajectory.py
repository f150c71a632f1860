"""Trajectory distance: the recording against each entry's stored run of the same commands."""

import numpy as np

from dynreg.errors import UsageError


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

"""From the commands of a log to what the drives are told: motor noise, largest step, the action's range."""

import numpy as np

from dynreg.sim.ports import Ports


def shaped_commands(
    actions: np.ndarray,
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    ports: Ports,
    noise: np.ndarray | None,
) -> np.ndarray:
    """(n, T, A) commands after the control port, for n simulations.

    Parameters
    ----------
    actions : (n, T, A) as commanded.
    start : (n, A) where the commands start from, for the largest step: joint positions, or zero torque.
    low, high : (n, A) limits of the commands.
    noise : (n, T, A) standard normal draws, times `control.noise` of each simulation; None for none.
    """
    return noisy(limited(actions, start, low, high, ports), ports, noise)


def limited(
    actions: np.ndarray, start: np.ndarray, low: np.ndarray, high: np.ndarray, ports: Ports
) -> np.ndarray:
    """(n, T, A) commands within their limits and largest step; as in `shaped_commands`."""
    commands = np.clip(actions, low[:, None], high[:, None])
    largest = ports.control["max_step"][:, None]
    if np.isfinite(largest).any():
        commands = commands.copy()
        previous = start
        for t in range(commands.shape[1]):
            step = commands[:, t] - previous
            # a command within reach is taken as it is: to the bit what it would be without the limit
            previous = np.where(
                np.abs(step) <= largest, commands[:, t], previous + np.clip(step, -largest, largest)
            )
            commands[:, t] = previous
    return commands


def noisy(commands: np.ndarray, ports: Ports, noise: np.ndarray | None) -> np.ndarray:
    """(n, T, A) commands with the motor noise of their simulations, from standard normal draws; None for none."""
    return commands if noise is None else commands + ports.control["noise"][:, None, None] * noise

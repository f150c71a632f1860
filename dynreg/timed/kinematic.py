"""The kinematic model: wheels turn as they are told at once, and the base drives arcs. Closed form."""

import numpy as np

from dynreg.timed.commands import Commands

STRAIGHT = 1e-6  # rad/s: below it the arc is a line


def kinematic(commands: Commands, track: float | np.ndarray) -> np.ndarray:
    """(..., n, 3) displacements of commands (n,) with the wheels `track` (...) [m] apart.

    Pretorius et al., equations 1 to 3, with the robot looking along y.
    """
    track = np.asarray(track, dtype=float)[..., None]
    speed = 0.5 * (commands.right + commands.left)
    turning = (commands.right - commands.left) / track
    angle = turning * commands.seconds
    straight = np.abs(turning) < STRAIGHT
    radius = speed / np.where(straight, 1.0, turning)
    ahead = np.where(straight, speed * commands.seconds, radius * np.sin(angle))
    right = np.where(straight, 0.0, radius * (np.cos(angle) - 1.0))
    return np.stack([right, ahead, np.where(straight, 0.0, angle)], axis=-1)

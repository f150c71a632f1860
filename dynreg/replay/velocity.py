"""How fast a planar base is on its way where a replay begins, from the poses around that row."""

import numpy as np

from dynreg.sim.robot import Robot

SPAN = 0.1  # s to either side: short against what a base takes to gather speed, long against a pose's noise
POSE = ("x", "y", "yaw")


def base_velocities(robot: Robot, values: np.ndarray, rows: np.ndarray, period: float) -> np.ndarray | None:
    """(n, 2) speed ahead [m/s] and yaw rate [rad/s] at `rows` (n,) of states (T, S) that are `period` [s] apart.

    The slope of the poses within 0.1 s. NaN where fewer than two rows were measured; None for robots whose pose is no
    channel.
    """
    columns = pose_columns(robot)
    if columns is None:
        return None
    reach, out = max(round(SPAN / period), 1), np.full((len(rows), 2), np.nan)
    for number, row in enumerate(rows):
        first = max(row - reach, 0)
        near = values[first : row + reach + 1][:, columns]
        known = np.flatnonzero(np.isfinite(near).all(axis=1))
        if len(known) < 2:
            continue
        pose = near[known].copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        vx, vy, turning = np.polyfit(known * period, pose - pose[0], 1)[0]
        heading = pose[np.abs(known + first - row).argmin(), 2]
        out[number] = vx * np.cos(heading) + vy * np.sin(heading), turning
    return out


def pose_columns(robot: Robot) -> np.ndarray | None:
    """(3,) of a planar base's pose among its robot's channels; None for robots whose pose is no channel."""
    columns = [i for kind in POSE for i, c in enumerate(robot.channels) if c.endswith(f"/{kind}")]
    return np.array(columns) if robot.planar and len(columns) == len(POSE) else None

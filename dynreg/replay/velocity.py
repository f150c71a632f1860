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
    columns = [i for kind in POSE for i, c in enumerate(robot.channels) if c.endswith(f"/{kind}")]
    if not robot.planar or len(columns) != len(POSE):
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


def told_velocities(robot: Robot, commands: np.ndarray) -> np.ndarray:
    """(n, 2) speed [m/s] and yaw rate [rad/s] that commands (n, A) ask of a planar base by its nameplate."""
    names, base = robot.actions, robot.file.base
    if base is None:
        order = [
            names.index(n)
            for kind in ("/speed_command", "/yaw_rate_command")
            for n in names
            if n.endswith(kind)
        ]
        return commands[:, order]
    left, right = (
        base.wheel_radius * commands[:, names.index(f"{wheel}/velocity_command")]
        for wheel in (base.left, base.right)
    )
    return np.stack([0.5 * (left + right), (right - left) / base.track], axis=1)

"""How fast a planar base is on its way where a replay begins, from the poses around that row."""

import numpy as np

from dynreg.sim.robot import Robot

SPAN = 0.1  # s to either side: short against what a base takes to gather speed, long against a pose's noise
MEMORY = 20.0  # lags after which a command is forgotten
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


def told_velocity(robot: Robot, commands: np.ndarray, period: float) -> np.ndarray:
    """(2,) speed [m/s] and yaw rate [rad/s] of a planar base after commands (T, A), each held for `period` [s].

    By its nameplate, from standstill; what was told more than `MEMORY` lags ago is forgotten.
    """
    names, base = robot.actions, robot.file.base
    if base is None:  # told a speed and a yaw rate, which it has at once
        kinds = ("/speed_command", "/yaw_rate_command")
        return commands[-1, [names.index(n) for kind in kinds for n in names if n.endswith(kind)]]
    left, right = (
        base.wheel_radius * commands[:, names.index(f"{wheel}/velocity_command")]
        for wheel in (base.left, base.right)
    )
    told = np.stack([0.5 * (left + right), (right - left) / base.track], axis=1)
    out = np.zeros(2)
    for axis, (lag, drag) in enumerate(((base.speed_lag, base.speed_drag), (base.yaw_lag, base.yaw_drag))):
        stays = np.exp(-drag * period / lag) if lag else 0.0
        some = told[-max(int(MEMORY * lag / period), 1) :, axis] / drag
        out[axis] = (1.0 - stays) * some @ stays ** np.arange(len(some) - 1, -1, -1.0)
    return out

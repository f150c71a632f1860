"""Where a robot on feet stands and which way it looks at first, taken out of what was measured.

A simulation that begins in the pose of the keyframe stands at the origin and looks along x. A log begins wherever the
robot stood. On level ground nothing hangs on that.
"""

import numpy as np

from dynreg.replay.windows import STILL
from dynreg.sim.layout import BASE, layout_of
from dynreg.sim.robot import Robot

PLACE = tuple(BASE.index(name) for name in ("x", "y", "yaw"))


def begins_anywhere(robot: Robot) -> bool:
    """Whether replays begin in any measured state; a floating base that no log places begins in the keyframe's pose."""
    return not robot.floating or robot.file.reset.base == "measured"


def from_the_start(robot: Robot, measured: np.ndarray) -> np.ndarray:
    """Rows (W, T+1, S) with the place and heading of the base counted from those of each window's first row.

    Velocities are told in the frame of the body, and stay. Windows that begin at the origin but for noise stay as they
    are, and so do all of a robot that has no floating base, or whose simulations begin where the log says.
    """
    if begins_anywhere(robot):
        return measured
    columns, which = layout_of(robot).base
    found = {int(i): int(c) for c, i in zip(columns, which, strict=True) if i in PLACE}
    if not found:
        return measured
    known = list(found.values())
    first = np.nan_to_num(measured[:, :1, known])
    away = (np.abs(first) > STILL * robot.sensor_noise[known]).any(axis=(1, 2))
    if not away.any():
        return measured
    out = measured.copy()
    out[..., known] -= np.where(away[:, None, None], first, 0.0)
    x, y, yaw = (found.get(i) for i in PLACE)
    if None not in (x, y, yaw):
        heading = np.where(away, first[:, 0, known.index(yaw)], 0.0)[:, None]
        ahead, left = out[..., x].copy(), out[..., y].copy()
        out[..., x] = np.cos(heading) * ahead + np.sin(heading) * left
        out[..., y] = np.cos(heading) * left - np.sin(heading) * ahead
    return out

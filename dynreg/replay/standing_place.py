"""Where a robot on feet stands and which way it looks at first, taken out of what was measured.

A simulation that begins in the pose of the keyframe stands and looks as the keyframe has it. A log begins wherever the
robot stood. On level ground nothing hangs on that.
"""

import numpy as np

from dynreg.replay.windows import STILL
from dynreg.sim.layout import PLACE, layout_of, start_place
from dynreg.sim.robot import Robot


def begins_anywhere(robot: Robot) -> bool:
    """Whether replays begin in any measured state; a floating base that no log places begins in the keyframe's pose."""
    return not robot.floating or robot.file.reset.base == "measured"


def from_the_start(robot: Robot, measured: np.ndarray) -> np.ndarray:
    """Rows (W, T+1, S) with the base moved and turned, so that each window begins where the keyframe has it.

    Velocities are told in the frame of the body, and stay. Windows that begin there but for noise stay as they are, and
    so do all of a robot that has no floating base, or whose simulations begin where the log says.
    """
    if begins_anywhere(robot):
        return measured
    layout = layout_of(robot)
    columns, which = layout.base
    found = {int(i): int(c) for c, i in zip(columns, which, strict=True) if i in PLACE}
    if not found:
        return measured
    known, start = list(found.values()), start_place(robot, layout)[[PLACE.index(i) for i in found]]
    first = measured[:, :1, known]
    first = np.where(np.isnan(first), start, first)
    away = (np.abs(first - start) > STILL * robot.sensor_noise[known]).any(axis=(1, 2))
    if not away.any():
        return measured
    out = measured.copy()
    out[..., known] -= np.where(away[:, None, None], first, 0.0)
    x, y, yaw = (found.get(i) for i in PLACE)
    if None not in (x, y, yaw):
        turn = known.index(yaw)
        heading = np.where(away, first[:, 0, turn] - start[turn], 0.0)[:, None]
        ahead, left = out[..., x].copy(), out[..., y].copy()
        out[..., x] = np.cos(heading) * ahead + np.sin(heading) * left
        out[..., y] = np.cos(heading) * left - np.sin(heading) * ahead
    out[..., known] += np.where(away[:, None, None], start, 0.0)
    return out

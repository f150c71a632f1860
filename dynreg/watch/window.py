"""MuJoCo's viewer with frames played in it; the measured robot is a pale copy beside the simulated one."""

import math
import os
import sys
import threading
import time
from typing import Any

import mujoco
import numpy as np

from dynreg.errors import PictureError, UsageError
from dynreg.watch.frames import MEASURED, Frames

RATE = 60.0  # frames a second
PATIENCE = 5.0  # s for the window to go
GHOST = (0.45, 0.48, 0.52, 0.45)


def require_display() -> None:
    """PictureError where there is no display."""
    if sys.platform.startswith("linux") and not any(
        os.environ.get(n) for n in ("DISPLAY", "WAYLAND_DISPLAY")
    ):
        raise PictureError(
            "there is no display (DISPLAY and WAYLAND_DISPLAY are not set)",
            expected="a desktop, for MuJoCo's viewer",
            do="write a file instead: `dynreg export ID --as rerun --to run.rrd`, --as foxglove, or --as gif of a gait",
        )


def at(frames: Frames, t: float) -> int:
    """The number of the frame that is shown t seconds after the start; after the last frame the first follows."""
    length = float(frames.times[-1] - frames.times[0])
    place = frames.times[0] + (t % length if length > 0 else 0.0)
    return int(np.searchsorted(frames.times, place, side="right") - 1)


def require_seconds(seconds: float | None) -> None:
    """Raises UsageError for a time [s] that is no finite number above 0; None is no limit."""
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise UsageError(
            f"--seconds {seconds:g}",
            expected="a number of seconds above 0",
            do="leave --seconds out to look until you close the window",
        )


def show(frames: Frames, seconds: float | None = None) -> None:
    """Play frames in a window until it is closed, or for `seconds` [s]. PictureError where none can be opened."""
    require_display()
    import mujoco.viewer

    data, before = mujoco.MjData(frames.model), {*threading.enumerate()}
    try:
        window = mujoco.viewer.launch_passive(frames.model, data, show_left_ui=False, show_right_ui=False)
    except Exception as error:  # of GLFW or OpenGL, whose errors have no common base
        raise PictureError(
            f"MuJoCo's viewer did not open ({type(error).__name__}: {error})",
            expected="a desktop with OpenGL",
            do="write a file instead: `dynreg export ID --as rerun --to run.rrd`",
        ) from error
    with window:
        _play(frames, data, window, seconds)
    # a process that ends while the viewer still draws takes OpenGL away from under it
    for thread in {*threading.enumerate()} - before:
        thread.join(PATIENCE)


def _play(frames: Frames, data: mujoco.MjData, window: Any, seconds: float | None) -> None:
    main, ghost = next(reversed(frames.poses)), mujoco.MjData(frames.model)
    began = time.monotonic()
    while window.is_running() and (seconds is None or time.monotonic() - began < seconds):
        row = at(frames, time.monotonic() - began)
        with window.lock():
            place(frames, main, row, data)
            if main != MEASURED and MEASURED in frames.poses:
                place(frames, MEASURED, row, ghost)
                draw_ghost(frames.model, ghost, window.user_scn)
        window.sync()
        time.sleep(1.0 / RATE)


def place(frames: Frames, side: str, row: int, data: mujoco.MjData) -> None:
    """Move the bodies of `data` to where they are in a frame; they stay where they were if it has none of them."""
    pose = frames.poses[side][row]
    if np.isfinite(pose).all():
        data.qpos[:] = pose
    mujoco.mj_forward(frames.model, data)


def draw_ghost(model: mujoco.MjModel, data: mujoco.MjData, scene: Any) -> None:
    """Put the moving bodies of `data` into a scene, pale."""
    scene.ngeom = 0
    moving = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
    mujoco.mjv_addGeoms(model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), moving, scene)
    for geom in range(scene.ngeom):
        scene.geoms[geom].rgba[:] = GHOST

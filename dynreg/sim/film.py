"""Pictures of a robot that moves, drawn by MuJoCo without a screen."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dynreg.errors import PictureError

if TYPE_CHECKING:
    import mujoco

FORMS = ("gif", "png")
FRAMES = 12.5  # a second, of a GIF: its pauses are whole hundredths of a second
STILLS = 4  # of a strip
HOME = Path(__file__).parents[2]  # the drawing program finds this dynreg there, and not what else lies about
PATIENCE = (120.0, 5.0)  # s that drawing may take in all, and for each frame


def moments(seconds: float, form: str, period: float) -> np.ndarray:
    """(F,) times [s] that are drawn: all of a GIF's, or those of a strip, through one period in the middle."""
    if form == "gif":
        return np.arange(int(seconds * FRAMES + 1e-9) + 1) / FRAMES
    begin = max(min(seconds / 2, seconds - period), 0.0)
    return np.minimum(begin + period * np.arange(STILLS) / STILLS, seconds)


def draw(model: "mujoco.MjModel", poses: np.ndarray, rate: float, times: np.ndarray, form: str) -> bytes:
    """A picture, one of FORMS, of a model in poses (T, nq), `rate` a second, as they are at `times` (F,).

    Another process draws it, with EGL, else OSMesa, or with what MUJOCO_GL names. Times after a divergence are left
    out. Raises PictureError where none of them works, or nothing can be drawn.
    """
    import mujoco

    known = poses[~np.isnan(poses).any(axis=1)]
    have = np.arange(len(known)) / rate
    times = times[times <= have[-1] + 1e-9] if len(known) else times[:0]
    if not len(times):
        raise PictureError(
            "there is nothing to draw: the simulation diverged at once",
            expected="a robot that moves",
            do="choose another simulator",
        )
    frames = np.stack([np.interp(times, have, joint) for joint in known.T], axis=1)
    patience, failed = PATIENCE[0] + PATIENCE[1] * len(times), []
    with tempfile.TemporaryDirectory() as folder:
        files = [f"{folder}/model.mjb", f"{folder}/poses.npz"]
        mujoco.mj_saveModel(model, files[0])
        np.savez(files[1], times=times, poses=frames)
        for backend in backends():
            picture = Path(folder) / f"{backend or 'own'}.{form}"
            problem = _run(backend, [*files, form, str(picture)], patience)
            if problem is None:
                return picture.read_bytes()
            failed.append(f"{backend or 'OpenGL'}: {problem}")
    raise PictureError(
        f"no picture was drawn ({'; '.join(failed)})",
        expected="an OpenGL that draws without a screen",
        do="install EGL (Debian: apt-get install libegl1 libgl1-mesa-dri) or OSMesa (libosmesa6)",
    )


def backends() -> tuple[str, ...]:
    """Values of MUJOCO_GL to try: what the user set, else what draws without a screen here."""
    # the program `dynreg` sets what the user chose aside before MuJoCo is imported
    own = os.environ.get("DYNREG_GL", os.environ.get("MUJOCO_GL", "")).strip()
    if own:
        return (own,)
    return ("egl", "osmesa") if sys.platform.startswith("linux") else ("",)


def _run(backend: str, arguments: list[str], patience: float) -> str | None:
    """Draw with one OpenGL; None where it did, else what went wrong, in a line."""
    environment = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    command = [sys.executable, "-m", "dynreg.sim.camera", *arguments]
    try:
        done = subprocess.run(
            command,
            env=environment | ({"MUJOCO_GL": backend} if backend else {}),
            cwd=HOME,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience,
        )
    except subprocess.TimeoutExpired:
        return f"took longer than {patience:.0f} s"
    if done.returncode == 0 and Path(arguments[-1]).is_file():
        return None
    said = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
    return said[-1][:200]

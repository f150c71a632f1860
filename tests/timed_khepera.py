"""A Khepera with timed commands, seen by a tracker alone: its folder, and logs with a row where each command begins."""

import re
import shutil
from pathlib import Path

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot
from dynreg.timed.commands import chained, drawn
from dynreg.timed.unicycle import unicycle

WHEEL = re.compile(r'\[\[channels\]\]\nname = "\w+_wheel/(?:position|velocity)"\n(?:[^\[\n].*\n)*\n')
NOISE = np.array([0.001, 0.001, 0.0087])  # m, m, rad


def timed_folder(folder: Path, horizon: float = 5.0) -> Path:
    """diffdrive with control = "timed" and its pose as channels, replayed in windows of `horizon` [s]."""
    made = folder / "timed_khepera"
    shutil.copytree(load_robot("diffdrive").folder, made)
    text = WHEEL.sub("", (made / "robot.toml").read_text(encoding="utf-8"))
    text = text.replace("control_rate = 50.0", 'control = "timed"').replace('"diffdrive"', '"timed_khepera"')
    (made / "robot.toml").write_text(f"{text}\n[replay]\nhorizon = {horizon}\n", encoding="utf-8")
    return made


def timed_log(robot: Robot, many: int = 40, *, noise: float = 0.0, **law: float) -> Recording:
    """Drawn commands, times in hundredths, by the dynamic model with the robot's own parameters but for `law`.

    noise : times the tracker's.
    """
    base, commands = robot.file.base, drawn(many, stream(2, "timed"))
    commands.seconds[:] = np.round(commands.seconds, 2)
    names = ("speed_lag", "yaw_lag", "centrifugal", "speed_drag", "coupling", "yaw_drag")
    pose = chained(unicycle(commands, np.array([law.get(n, getattr(base, n)) for n in names]), base.track))
    pose = pose + noise * NOISE * stream(3, "tracker").standard_normal(pose.shape)
    told = np.stack([commands.left, commands.right], axis=1) / base.wheel_radius
    values = np.concatenate([pose, np.concatenate([told, told[-1:]])], axis=1)
    tables = (*robot.file.channels, *robot.file.actions)
    time = 3.0 + np.concatenate([[0.0], np.cumsum(commands.seconds)])
    return Recording(tuple(Channel(t.name, t.unit) for t in tables), (Episode("drive", time, values),))

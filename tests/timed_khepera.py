"""A Khepera with timed commands, seen by a tracker alone: its folder, and logs with a row where each command begins."""

import re
import shutil
from pathlib import Path

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.timed.commands import drawn

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


def timed_log(
    robot: Robot,
    many: int = 40,
    *,
    noise: float = 0.0,
    seconds: tuple[float, float] = (0.1, 2.0),
    rest: float = 0.0,
    **values: float,
) -> Recording:
    """Drawn commands, times in hundredths, by the dynamic model at the robot's nominal parameters but for `values`.

    noise : times the tracker's. rest : [s] for which the robot stands first.
    """
    commands, step = drawn(many, stream(2, "timed"), seconds=seconds), robot.file.robot.timestep
    if rest:
        commands.left[0] = commands.right[0] = 0.0
        commands.seconds[0] = rest
    steps = np.round(commands.seconds / step).astype(int)
    told = np.stack([commands.left, commands.right], axis=1) / robot.file.base.wheel_radius
    run = Run(np.repeat(told, steps, axis=0)[None], period=step)
    law = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | values)[None]
    rows = np.concatenate([[0], np.cumsum(steps)])
    pose = rollout(robot, law, run, engine="unicycle").states[0, 0, rows]
    pose = pose + noise * NOISE * stream(3, "tracker").standard_normal(pose.shape)
    table = np.concatenate([pose, np.concatenate([told, told[-1:]])], axis=1)
    tables = (*robot.file.channels, *robot.file.actions)
    return Recording(
        tuple(Channel(t.name, t.unit) for t in tables), (Episode("drive", 3.0 + step * rows, table),)
    )

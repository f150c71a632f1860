"""The quadruped with its parts weighed and measured; also as a folder, which registered recordings are of."""

import re
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.space import ParameterSpace

# 1 sigma of what scales, rulers, a pull on the standing robot and the controller's own file tell
KNOWN = {
    "friction": 0.03,
    "torque": 0.02,
    "joint_speed": 0.05,
    "joint_limits": 0.01,
    "largest_step": 0.01,
    "upper_length": 0.01,
    "lower_length": 0.01,
    "torso_mass": 0.02,
    "leg_mass": 0.02,
    "inertia": 0.2,
    "gravity": 0.001,
}
TORQUE = 2.0  # N m: with less the robot topples as soon as it carries more or a servo is weaker
BLOCK = re.compile(r'(\[\[parameters\]\]\nname = "(\w+)"\n)(.*?)(?=\n\n|\Z)', re.DOTALL)
YAW = '[[channels]]\nname = "base/yaw"\nunit = "rad"\n'  # it drifts as feet slip: what it does is chance


def measured(robot: Robot) -> Robot:
    """The robot with its parameters known as well as `KNOWN` says, and with servos that carry it when it walks."""
    space = tuple(replace(p, tolerance=KNOWN.get(p.name, p.tolerance)) for p in robot.space.parameters)
    space = tuple(replace(p, nominal=TORQUE) if p.name == "torque" else p for p in space)
    # the heading drifts as feet slip: what it does after a second is chance
    channels = [
        c.model_copy(update={"weight": 0.0}) if c.name == "base/yaw" else c for c in robot.file.channels
    ]
    file = robot.file.model_copy(update={"channels": channels})
    return replace(robot, space=ParameterSpace(space), file=file)


@cache
def measured_quadruped() -> Robot:
    """The robot as scales, rulers and its controller's file tell it; its folder is removed when the program ends."""
    folder = Path(_place().name) / "quadruped"
    shutil.copytree(load_robot("quadruped").folder, folder)
    path = folder / "robot.toml"
    text = BLOCK.sub(_told, path.read_text(encoding="utf-8"))
    path.write_text(text.replace(YAW, YAW + "weight = 0.0\n"), encoding="utf-8")
    return load_robot(folder)


@cache
def _place() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="measured_quadruped_")


def _told(block: re.Match) -> str:
    head, name, rest = block.groups()
    if name == "torque":
        rest = re.sub(r"nominal = .*", f"nominal = {TORQUE}", rest)
    if name in KNOWN:
        rest = re.sub(r"tolerance = .*\n", "", rest).replace("sets = ", f"tolerance = {KNOWN[name]}\nsets = ")
    return head + rest

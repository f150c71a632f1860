"""The quadruped of `bench_naming_quadruped` as a folder of its own, which registered recordings are of.

Its robot.toml is the packaged one, with what scales, rulers and the controller's file tell in it.
"""

import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

from bench_naming_quadruped import KNOWN, TORQUE

from dynreg.sim.robot import Robot, load_robot

BLOCK = re.compile(r'(\[\[parameters\]\]\nname = "(\w+)"\n)(.*?)(?=\n\n|\Z)', re.DOTALL)
YAW = '[[channels]]\nname = "base/yaw"\nunit = "rad"\n'  # it drifts as feet slip: what it does is chance


@cache
def measured_quadruped() -> Robot:
    """The robot; its folder is removed when the program ends."""
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

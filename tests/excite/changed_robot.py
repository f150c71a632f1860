"""A packaged robot with other text in its files."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from dynreg.sim.robot import Robot, load_robot, packaged_robots


def changed(
    folder: Path, name: str, file: Mapping[str, str], model: Mapping[str, str] | None = None
) -> Robot:
    """The robot `name`, copied to a new `folder`, with pieces of robot.toml and of its model replaced."""
    shutil.copytree(packaged_robots()[name], folder)
    for path, pieces in (("robot.toml", file), ("model.xml", model or {})):
        text = (folder / path).read_text(encoding="utf-8")
        for old, new in pieces.items():
            assert old in text, old
            text = text.replace(old, new)
        (folder / path).write_text(text, encoding="utf-8")
    return load_robot(str(folder))

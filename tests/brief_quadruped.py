"""The quadruped with short trials, for every test that walks."""

from pathlib import Path

import pytest

from dynreg.data.recording import Recording
from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot, load_robot, packaged_robots

SECONDS = 1.0


@pytest.fixture(scope="session")
def quadruped() -> Robot:
    return load_robot("quadruped")


@pytest.fixture(scope="session")
def brief_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the quadruped's folder in which every task lasts a second."""
    import re
    import shutil

    folder = tmp_path_factory.mktemp("brief") / "quadruped"
    shutil.copytree(packaged_robots()["quadruped"], folder)
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    head, mark, tasks = text.partition("[[tasks]]")
    tasks = re.sub(r"^seconds = .*\n", "", tasks, flags=re.MULTILINE)
    tasks = re.sub(r"^(kind = .*)$", rf"\1\nseconds = {SECONDS}", tasks, flags=re.MULTILINE)
    (folder / "robot.toml").write_text(head + mark + tasks, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def brief(brief_folder: Path) -> Robot:
    return load_robot(brief_folder)


@pytest.fixture(scope="session")
def short_log(brief: Robot) -> Recording:
    """What the nominal robot logs of thirty commands."""
    actions = excitation(brief, seed=1, episodes=1, steps=30).actions[0]
    return SimulatedRobot(brief, brief.space.nominal, seed=1).run(actions, brief.rate).recording

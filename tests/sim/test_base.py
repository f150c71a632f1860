"""The base of a robot is what carries its driven joints, whatever else moves freely in the model."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import RobotError
from dynreg.sim.beside import bodies_beside
from dynreg.sim.effects.body import carrier
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.layout import layout_of
from dynreg.sim.robot import Robot, load_robot, packaged_robots
from dynreg.sim.stand import on_stand

CUBE = (
    '<body name="cube" pos="1 1 0.05"><freejoint name="cube"/>'
    '<geom name="cube" type="box" size="0.05 0.05 0.05" mass="9"/></body>'
)


def beside_a_cube(path: Path, name: str, channel: str = "") -> Robot:
    """A packaged robot after a heavy cube in the model; with one more channel."""
    shutil.copytree(packaged_robots()[name], path)
    model = (path / "model.xml").read_text(encoding="utf-8")
    model = model.replace("</light>", "").replace("<worldbody>", f"<worldbody>{CUBE}", 1)
    model = re.sub(r'(<key [^>]*qpos=")', r"\g<1>1 1 0.05 1 0 0 0 ", model)
    (path / "model.xml").write_text(model, encoding="utf-8")
    told = (path / "robot.toml").read_text(encoding="utf-8")
    more = f'\n[[channels]]\nname = "{channel}"\nunit = "m"\n' if channel else ""
    (path / "robot.toml").write_text(told + more, encoding="utf-8")
    return load_robot(path)


def test_a_walker_moves_as_it_does_without_the_cube_before_it(tmp_path: Path):
    alone, robot = load_robot("quadruped"), beside_a_cube(tmp_path / "quadruped", "quadruped")
    assert robot.floating and robot.model.joint(robot.base).name == "base"
    run = excitation(alone, seed=1, name="cube", episodes=1, steps=20)
    states = [rollout(r, r.space.nominal[None], run).states[0] for r in (alone, robot)]
    np.testing.assert_allclose(states[1], states[0], atol=1e-9)
    assert robot.model.body(carrier(robot)).name == "torso" and [*bodies_beside(robot)] == ["cube"]
    held = on_stand(robot)
    assert not held.floating and held.model.nq == len(held.actions)


def test_an_arm_beside_a_cube_does_not_float(tmp_path: Path):
    alone, robot = load_robot("two_joint_arm"), beside_a_cube(tmp_path / "two_joint_arm", "two_joint_arm")
    assert robot.base == -1 and not robot.floating
    assert robot.model.body(carrier(robot)).name == alone.model.body(carrier(alone)).name
    runs = [excitation(one, seed=1, name="arm", episodes=3, steps=20) for one in (alone, robot)]
    np.testing.assert_array_equal(runs[1].initial, runs[0].initial)


def test_a_channel_of_another_free_joint_is_refused(tmp_path: Path):
    robot = beside_a_cube(tmp_path / "quadruped", "quadruped", "cube/z")
    with pytest.raises(RobotError, match="'cube' carries no joint that is driven.*the robot's base, 'base'"):
        layout_of(robot)

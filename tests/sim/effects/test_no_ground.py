"""Robots that touch nothing of the world: effects of contact are not offered to a diagnosis."""

from pathlib import Path

import pytest

from dynreg.sim.effects import applicable, effects
from dynreg.sim.effects.contact import has_ground
from dynreg.sim.robot import Robot, load_robot, packaged_robots

GROUND = '<geom name="ground" type="plane" size="5 5 0.1" conaffinity="1"'
CONTACT = {"ground_friction", "second_friction_material", "contact_compliance"}


def quadruped(folder: Path, ground: str) -> Robot:
    """The packaged quadruped on another ground."""
    source = packaged_robots()["quadruped"]
    model = (source / "model.xml").read_text(encoding="utf-8")
    assert GROUND in model
    (folder / "model.xml").write_text(model.replace(GROUND, ground), encoding="utf-8")
    (folder / "robot.toml").write_bytes((source / "robot.toml").read_bytes())
    return load_robot(folder)


@pytest.mark.parametrize("conaffinity", [1, 0])
def test_effects_of_contact_need_a_ground(tmp_path: Path, conaffinity: int):
    robot = quadruped(tmp_path, GROUND.replace('conaffinity="1"', f'conaffinity="{conaffinity}"'))
    assert has_ground(robot) == bool(conaffinity)
    assert CONTACT & set(applicable(robot)) == (CONTACT if conaffinity else set())


def test_feet_that_touch_each_other_are_no_ground(tmp_path: Path):
    robot = quadruped(tmp_path, '<geom name="sky" type="plane" size="5 5 0.1" conaffinity="0"')
    (tmp_path / "model.xml").write_text(
        (tmp_path / "model.xml").read_text().replace('contype="1"', 'contype="1" conaffinity="1"')
    )
    robot = load_robot(tmp_path)
    assert not CONTACT & set(applicable(robot))
    assert "no ground" in effects()["second_friction_material"].why_not(robot)

"""Whose friction and softness a contact with the ground has: of geoms with a `priority`, and of `<pair>` contacts."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dynreg.extend.robot_folder import export_robot
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Terms, applicable, effects, term
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

XML = """
<mujoco><worldbody><geom name="floor" type="plane" size="5 5 0.1" friction="0.9" {floor}/>
<body name="base" pos="0 0 0.05"><freejoint name="root"/>
  <geom name="left" type="sphere" size="0.05" pos="0 0.1 0" friction="0.6" {feet}/>
  <geom name="right" type="sphere" size="0.05" pos="0 -0.1 0" friction="0.6" {feet}/>
  <geom name="front" type="sphere" size="0.05" pos="0.2 0 0" friction="0.6"/>
  <body name="flap" pos="0 0 0.5"><joint name="flap" axis="0 1 0"/><geom type="sphere" size="0.01" pos="0 0 0.1"
    contype="0" conaffinity="0"/></body>
</body></worldbody><actuator><position name="flap" joint="flap"/></actuator><contact>{pairs}</contact></mujoco>
"""
TOML = """
[robot]
name = "tripod"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.002

[[drives]]
joint = "flap"
type = "position"
gain = 2.0

[[actions]]
name = "flap/target"
unit = "rad"
low = -1.0
high = 1.0

[[channels]]
name = "flap/position"
unit = "rad"
noise = 0.0001

[[parameters]]
name = "flap_damping"
unit = "N*m*s/rad"
nominal = 0.1
low = 0.05
high = 0.2
sets = ["mj.dof_damping[flap] ="]
"""
PAIRS = "".join(
    f'<pair name="{foot}" geom1="floor" geom2="{foot}" friction="0.8 0.8" solref="0.02 1"/>'
    for foot in ("left", "right", "front")
)


@pytest.fixture
def tripod(tmp_path: Path) -> Callable[..., Robot]:
    """Writes and loads a robot on three feet, of which one is on the left, with other contacts."""

    def write(floor: str = "", feet: str = "", pairs: str = "") -> Robot:
        (tmp_path / "model.xml").write_text(XML.format(floor=floor, feet=feet, pairs=pairs))
        (tmp_path / "robot.toml").write_text(TOML)
        return load_robot(tmp_path)

    return write


def contacts(robot: Robot, key: str, size: float) -> dict[str, mujoco.MjContact]:
    """{foot: its contact with the floor} of the robot that stands, with an effect of this size."""
    terms = Terms((term(key),), (np.array([[size]]),))
    run = Run(np.zeros((1, 1, 1)))
    model = Simulations(robot, robot.space.nominal[None], run, terms=terms).model(0)
    data = mujoco.MjData(model)
    data.qpos[2] = 0.049
    mujoco.mj_forward(model, data)
    return {model.geom(int(max(c.geom))).name: c for c in data.contact}


def frictions(robot: Robot, key: str, size: float) -> list[float]:
    """Of the feet left, right and front; the same in both directions."""
    found = contacts(robot, key, size)
    assert all(c.friction[0] == c.friction[1] for c in found.values())
    return [float(found[foot].friction[0]) for foot in ("left", "right", "front")]


@pytest.mark.parametrize(
    ("how", "plain"),
    [
        ({}, [0.9, 0.9, 0.9]),
        ({"feet": 'priority="1"'}, [0.6, 0.6, 0.9]),
        ({"floor": 'priority="-1"'}, [0.6, 0.6, 0.6]),
        ({"pairs": PAIRS}, [0.8, 0.8, 0.8]),
    ],
)
def test_a_second_material_changes_the_left_side_alone(tripod: Callable[..., Robot], how: dict, plain: list):
    robot = tripod(**how)
    assert frictions(robot, "second_friction_material", 0.0) == pytest.approx(plain)
    lost = [0.5 * plain[0], *plain[1:]]
    assert frictions(robot, "second_friction_material", 0.5) == pytest.approx(lost)
    assert frictions(robot, "ground_friction", -0.5) == pytest.approx([0.5 * one for one in plain])


def test_a_ground_of_higher_priority_has_one_friction_for_all(tripod: Callable[..., Robot]):
    robot = tripod(floor='priority="1"')
    assert "`priority`" in effects()["second_friction_material"].why_not(robot)
    assert "second_friction_material" not in applicable(robot)
    assert frictions(robot, "ground_friction", -0.5) == pytest.approx([0.45] * 3)


def test_contacts_of_pairs_soften_too(tripod: Callable[..., Robot]):
    for pairs, softer in ((PAIRS, (0.05, 1.0)), (PAIRS.replace("0.02 1", "-2500 -100"), (-400.0, -40.0))):
        found = contacts(tripod(pairs=pairs), "contact_compliance", 1.5)
        assert [tuple(c.solref) for c in found.values()] == [pytest.approx(softer)] * 3


def test_what_pairs_have_is_exported(tripod: Callable[..., Robot], tmp_path: Path):
    robot = tripod(pairs=PAIRS)
    config = SimConfig.of(robot, robot.space.nominal, {"ground_friction": {"change": -0.5}})
    export_robot(robot, config, tmp_path / "out")
    assert "mj.pair_friction[left,right,front][0]" in (tmp_path / "out" / "robot.toml").read_text()

"""Delays of a model's own actuators: they are left out everywhere alike, and a check says what to do."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dynreg.extend.robot_folder import export_robot
from dynreg.sim.config import SimConfig
from dynreg.sim.engines import rollout
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.lint import doubts
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

MODEL = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="arm" axis="0 1 0" armature="0.02"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.2" mass="0.3" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><position joint="arm" kp="10" kv="0.5" {delay}/></actuator>
  <keyframe><key name="start" qpos="1.0" ctrl="1.0"/></keyframe>
</mujoco>"""
TOML = """
[robot]
name = "late"
engines = ["mujoco", "joint"]
control_rate = 50.0
timestep = 0.002

[reset]
keyframe = "start"

[[drives]]
joint = "arm"
type = "position"
gain = 10.0
rate_gain = 0.5
torque_limit = 3.0

[[actions]]
name = "arm/target"
unit = "rad"

[[channels]]
name = "arm/position"
unit = "rad"
noise = 0.0005

[[parameters]]
name = "gain"
unit = "1"
nominal = 1.0
low = 0.5
high = 1.5
sets = ["port.drive.gain_factor *="]
"""


def written(folder: Path, delay: str) -> Robot:
    folder.mkdir()
    (folder / "model.xml").write_text(MODEL.format(delay=delay), encoding="utf-8")
    (folder / "robot.toml").write_text(TOML, encoding="utf-8")
    return load_robot(folder)


@pytest.fixture
def late(tmp_path: Path) -> Robot:
    return written(tmp_path / "late", 'delay="0.05" nsample="60" interp="linear"')


@pytest.fixture
def prompt(tmp_path: Path) -> Robot:
    return written(tmp_path / "prompt", "")


def test_a_second_run_is_as_the_first(late: Robot) -> None:
    """What the first run had told the drive last came through at the start of the second."""
    run = Run(np.linspace(1.0, -1.0, 20)[None, :, None])
    held = Simulations(late, late.space.nominal[None], run)
    assert np.array_equal(held.play(run).states, held.play(run).states)


@pytest.mark.parametrize("engine", ["mujoco", "joint"])
def test_engines_move_it_as_without_the_delay(late: Robot, prompt: Robot, engine: str) -> None:
    """A start in a pose other than 0 began with a jerk besides: the drive had heard 0 before."""
    run = Run(np.full((1, 20, 1), 1.0))
    a, b = (rollout(one, one.space.nominal[None], run, engine=engine).states for one in (late, prompt))
    assert np.array_equal(a, b)


def test_the_check_says_that_it_is_left_out(late: Robot, prompt: Robot) -> None:
    (said,) = [message for _, message in doubts(late) if "delay" in message]
    assert "'arm/target' has a delay of 0.05 s, which dynreg leaves out" in said and "command_delay" in said
    assert not any("delay" in message for _, message in doubts(prompt))


@pytest.mark.parametrize("effects", [{}, {"command_delay": {"delay": 0.01}}])
def test_an_exported_model_has_the_simulators_delay_alone(late: Robot, effects: dict, tmp_path: Path) -> None:
    made = SimConfig.of(late, late.space.nominal, effects)
    export_robot(late, made, tmp_path / "taken")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "taken" / "mujoco.xml"))
    assert model.actuator_delay[0] == (0.01 if effects else 0.0)
    assert (model.actuator_history[0, 0] > 0) == bool(effects)

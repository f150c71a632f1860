"""Delays of a model's own actuators: they are left out everywhere alike, and a check says what to do."""

from pathlib import Path

import mujoco
import numpy as np
import one_arm
import pytest

from dynreg.extend.robot_folder import export_robot
from dynreg.sim.config import SimConfig
from dynreg.sim.engines import rollout
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.lint import doubts
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run


def written(folder: Path, delay: str) -> Robot:
    folder.mkdir()
    actuator = f'<position joint="arm" kp="10" kv="0.5" {delay}/>'
    return one_arm.written(folder, one_arm.model_of(actuator, 'qpos="1.0" ctrl="1.0"'))


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

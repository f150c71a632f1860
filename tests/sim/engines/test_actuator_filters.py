"""Actuators that smooth their commands: what they hold is a part of where an episode starts, and what drives follow."""

import mujoco
import numpy as np
import one_arm
import pytest

from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

MODEL = one_arm.model_of(
    """<general name="arm" joint="arm" dyntype="filterexact" dynprm="0.1" gainprm="10" biastype="affine"
             biasprm="0 -10 -0.5" forcelimited="true" forcerange="-3 3"/>""",
    'qpos="0.3" ctrl="0.3" act="0.3"',
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return one_arm.written(tmp_path_factory.mktemp("smooth"), MODEL, settle=0.3)


def moved(robot: Robot, run: Run, terms: Terms | None = None) -> np.ndarray:
    """(E, T+1) angles of the nominal robot."""
    return rollout(robot, robot.space.nominal[None], run, terms=terms).states[0, ..., 0]


def test_it_moves_as_mujoco_does(robot: Robot) -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 150)  # settled
    seen = [data.qpos[0]]
    for _ in range(30):
        data.ctrl[0] = 1.0
        mujoco.mj_step(model, data, 10)
        seen.append(data.qpos[0])
    assert moved(robot, Run(np.full((1, 30, 1), 1.0)))[0] == pytest.approx(seen, abs=1e-6)


def test_episodes_alike_and_a_second_run_begin_alike(robot: Robot) -> None:
    """Of several alike one alone kept what its filter held, and a second run began with what the first left."""
    run = Run(np.full((3, 20, 1), 0.8))
    first, *others = moved(robot, run)
    assert all(np.array_equal(first, one) for one in others)
    held = Simulations(robot, np.tile(robot.space.nominal, (3, 1)), run)
    assert np.array_equal(held.play(run).states, held.play(run).states)


def test_an_episode_that_begins_on_its_target_stays_there(robot: Robot) -> None:
    """The filter held 0, so that every window of a log began with a jerk."""
    start = np.array([[1.0, 0.0]])
    angles = moved(robot, Run(np.full((1, 40, 1), 1.0248), initial=start))[0]  # 0.0248 rad hold its weight
    assert np.abs(angles - 1.0).max() < 2e-3


def test_an_effect_on_the_drive_acts_on_what_the_filter_lets_through(robot: Robot) -> None:
    """The sag of a command that had not come through pushed the joint backwards."""
    run = Run(np.full((1, 30, 1), 1.0), initial=np.zeros((1, 2)))
    step = Run(np.concatenate([np.zeros((1, 1, 1)), np.ones((1, 29, 1))], axis=1), initial=np.zeros((1, 2)))
    sag = Terms((term("voltage_sag"),), (np.array([[0.4]]),))
    weak = moved(robot, step, sag)[0]
    assert (weak[:8] > -1e-3).all() and 0.05 < weak[-1] < moved(robot, run)[0, -1]

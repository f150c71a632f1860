from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_robot import parameter

from dynreg.errors import RobotError, SimulationError
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.space import Parameter
from dynreg.sim.spec import ChannelTable

PERIOD = 0.1


@pytest.fixture(scope="module")
def husky() -> Robot:
    return load_robot("husky")


@pytest.fixture(scope="module")
def husky_with_pose(husky: Robot) -> Robot:
    pose = [ChannelTable(name=f"base/{q}", unit="rad" if q == "yaw" else "m") for q in ("x", "y", "yaw")]
    return replace(husky, file=husky.file.model_copy(update={"channels": [*husky.file.channels, *pose]}))


def _values(robot: Robot, **values: float) -> np.ndarray:
    return robot.space.from_dict(values)[None]


def test_a_step_is_the_exact_first_order_lag(husky: Robot):
    actions = np.tile([0.8, -1.5], (1, 20, 1))
    values = _values(husky, speed_gain=0.9, yaw_gain=0.7, speed_lag=0.35, yaw_lag=0.04)
    states = rollout(husky, values, Run(actions)).states[0, 0]
    t = np.arange(21) * PERIOD
    np.testing.assert_allclose(states[:, 0], 0.9 * 0.8 * (1 - np.exp(-t / 0.35)), atol=1e-12)
    np.testing.assert_allclose(states[:, 1], -0.7 * 1.5 * (1 - np.exp(-t / 0.04)), atol=1e-12)


def test_steady_commands_drive_a_circle(husky_with_pose: Robot):
    robot, steps = husky_with_pose, 60
    values = _values(robot, speed_gain=1.0, yaw_gain=1.0)
    initial = np.array([[0.5, 0.8, 2.0, 1.0, 0.3]])  # already at the commanded velocities
    states = rollout(robot, values, Run(np.tile([0.5, 0.8], (1, steps, 1)), initial=initial)).states[0, 0]
    yaw = 0.3 + 0.8 * PERIOD * np.arange(steps + 1)
    radius = 0.5 / 0.8
    np.testing.assert_allclose(states[:, 4], yaw, atol=1e-12)
    np.testing.assert_allclose(states[:, 2], 2.0 + radius * (np.sin(yaw) - np.sin(0.3)), atol=1e-4)
    np.testing.assert_allclose(states[:, 3], 1.0 - radius * (np.cos(yaw) - np.cos(0.3)), atol=1e-4)


def test_the_pose_is_the_integral_of_the_velocities(husky_with_pose: Robot):
    run = replace(excitation(husky_with_pose, seed=0, episodes=3, steps=40), initial=np.zeros((3, 5)))
    fine = replace(run, actions=np.repeat(run.actions, 50, axis=1), period=PERIOD / 50, inputs=None)
    values = husky_with_pose.space.sample(0, 2, 0)
    coarse = rollout(husky_with_pose, values, run).states
    dense = rollout(husky_with_pose, values, fine).states
    np.testing.assert_allclose(coarse, dense[:, :, ::50], atol=2e-3)
    yaw = np.cumsum((dense[..., 1:, 1] + dense[..., :-1, 1]) / 2 * PERIOD / 50, axis=-1)
    np.testing.assert_allclose(dense[..., 1:, 4], yaw, atol=1e-3)
    speed, heading = ((dense[..., 1:, i] + dense[..., :-1, i]) / 2 for i in (0, 4))
    x = np.cumsum(speed * np.cos(heading) * PERIOD / 50, axis=-1)
    np.testing.assert_allclose(dense[..., 1:, 2], x, atol=1e-3)


def test_without_a_lag_velocities_are_there_at_once(husky: Robot):
    drives = [d.model_copy(update={"lag": 0.0}) for d in husky.file.drives]
    robot = replace(
        husky,
        file=husky.file.model_copy(update={"drives": drives}),
        space=replace(husky.space, parameters=()),
    )
    actions = np.random.default_rng(0).uniform(-1, 1, (2, 10, 2))
    states = rollout(robot, np.empty((1, 0)), Run(actions)).states[0]
    np.testing.assert_allclose(states[:, 1:], actions * [1.0, 0.9], atol=1e-12)


def test_commands_are_limited_and_simulators_independent(husky: Robot):
    values = husky.space.sample(0, 5, 0)
    run = excitation(husky, seed=1, episodes=3, steps=15)
    states = rollout(husky, values, run).states
    np.testing.assert_array_equal(
        rollout(husky, values[2:3], run.take(np.array([1]))).states, states[2:3, 1:2]
    )
    wild = rollout(husky, values, Run(np.full((1, 100, 2), 50.0))).states[:, 0, -1]
    np.testing.assert_allclose(wild, values[:, :2] * [1.0, 2.0], rtol=1e-3)


def test_simulators_with_other_command_rates_change_nothing(husky_with_pose: Robot):
    """A slow base in the batch must not give the quick one finer steps."""
    space = replace(
        husky_with_pose.space,
        parameters=(
            *husky_with_pose.space.parameters,
            Parameter("rate", "Hz", 10.0, 2.0, 50.0, "log", 0.1, ("control.rate =",)),
        ),
    )
    robot = replace(husky_with_pose, space=space)
    values = np.tile(space.nominal, (4, 1))
    values[:, -1] = [50.0, 10.0, 2.0, 7.0]
    run = Run(np.random.default_rng(0).uniform(-1, 1, (2, 12, 2)))
    together = rollout(robot, values, run)
    alone = [rollout(robot, values[i : i + 1], run) for i in range(4)]
    np.testing.assert_array_equal(together.states, np.concatenate([a.states for a in alone]))
    assert together.physics_steps == sum(a.physics_steps for a in alone) == 2 * 12 * (1 + 5 + 25 + 8)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "base/speed"', 'name = "base/velocity"', "channel 'base/velocity'.*speed"),
        ('name = "base/speed"', 'name = "chassis/speed"', "prefixes.*one base"),
        ('name = "base/speed_command"', 'name = "base/speed_target"', "speed_target"),
        ('type = "velocity"\ngain = 1.0\nlag = 0.2', 'type = "torque"', "drive.*velocity"),
    ],
)
def test_what_is_no_planar_base_is_refused(old: str, new: str, said: str, tmp_path: Path, husky: Robot):
    text = (husky.folder / "robot.toml").read_text()
    assert old in text
    (tmp_path / "robot.toml").write_text(text.replace(old, new))
    (tmp_path / "model.xml").write_text((husky.folder / "model.xml").read_text())
    robot = load_robot(tmp_path)
    with pytest.raises(RobotError, match=said):
        rollout(robot, robot.space.nominal[None], Run(np.zeros((1, 2, 2))))


def test_fields_of_mujoco_are_refused(tmp_path: Path, husky: Robot, write_robot: Callable[..., Path]):
    text = (husky.folder / "robot.toml").read_text()
    text = text[: text.index("[[parameters]]")] + parameter("mass", "mj.body_mass[base] =")
    (tmp_path / "robot.toml").write_text(text)
    (tmp_path / "model.xml").write_text((husky.folder / "model.xml").read_text())
    with pytest.raises(SimulationError, match=r"'mj.body_mass\[base\] ='.*no such field"):
        rollout(load_robot(tmp_path), np.array([[1.0]]), Run(np.zeros((1, 2, 2))))

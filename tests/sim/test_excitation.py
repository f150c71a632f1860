from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arm_robot import ARM_XML

from dynreg.errors import RobotError
from dynreg.sim.excitation import KINDS, excitation, reset_pose
from dynreg.sim.robot import load_robot, packaged_robots

ROBOTS = {name: load_robot(name) for name in packaged_robots()}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_seed_gives_the_same_bytes(name: str):
    robot = ROBOTS[name]
    first, again = (excitation(robot, seed=3, episodes=5, steps=20) for _ in range(2))
    for field in ("actions", "inputs", "settings"):
        assert getattr(first, field).tobytes() == getattr(again, field).tobytes()
    for other in (
        excitation(robot, seed=4, episodes=5, steps=20),
        excitation(robot, seed=3, name="probe", episodes=5, steps=20),
    ):
        assert not np.array_equal(other.actions, first.actions)


@pytest.mark.parametrize("name", ROBOTS)
def test_an_episode_does_not_depend_on_how_many_follow(name: str):
    robot = ROBOTS[name]
    few, many = (excitation(robot, seed=0, episodes=n, steps=15) for n in (3, 7))
    np.testing.assert_array_equal(many.actions[:3], few.actions)
    np.testing.assert_array_equal(many.settings[:3], few.settings)


@pytest.mark.parametrize("name", ROBOTS)
def test_commands_respect_the_limits_and_use_their_room(name: str):
    robot = ROBOTS[name]
    run = excitation(robot, seed=0)
    file = robot.file.excitation
    assert run.actions.shape == (file.episodes, file.steps, len(robot.actions))
    low, high = (np.array([getattr(a, end) for a in robot.file.actions]) for end in ("low", "high"))
    assert np.all(run.actions >= low) and np.all(run.actions <= high)
    used = np.ptp(run.actions, axis=(0, 1)) / (high - low)
    assert np.all(used > 0.5 * file.amplitude)
    assert np.all(np.abs(reset_pose(robot)) <= np.maximum(np.abs(low), np.abs(high)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rate", [0.1, 2.0, 4.9, 10.0, 36.0, 500.0])
def test_offsets_of_every_kind_move_every_joint_within_bounds(kind: str, rate: float):
    offsets = np.stack([KINDS[kind](np.random.default_rng(seed), 200, 3, rate) for seed in range(4)])
    assert np.abs(offsets).max() <= (2.0 if kind == "gait" else 1.0)
    assert np.all(np.std(offsets, axis=(0, 1)) > 0.02)


def test_settings_cover_their_values_with_every_kind():
    robot = ROBOTS["servo_pendulum"]
    kinds, setting = robot.file.excitation.kinds, robot.file.settings[0]
    episodes = len(kinds) * len(setting.values)
    run = excitation(robot, seed=0, episodes=episodes, steps=10)
    pairs = {(kinds[e % len(kinds)], run.settings[e, 0]) for e in range(episodes)}
    assert pairs == {(kind, value) for kind in kinds for value in setting.values}


def test_inputs_stay_in_their_range_and_a_drop_switches_off_half_way():
    robot = ROBOTS["servo_pendulum"]
    supply, enabled = (robot.inputs.index(name) for name in ("supply", "arm/enabled"))
    table = robot.file.inputs[supply]
    run = excitation(robot, seed=0, steps=40)
    drops = [e for e in range(run.episodes) if robot.file.excitation.kinds[e % 4] == "drop"]
    others = [e for e in range(run.episodes) if e not in drops]
    assert np.all(run.inputs[:, :20, enabled] == 1) and np.all(run.inputs[others][:, :, enabled] == 1)
    assert len(drops) and np.all(run.inputs[drops][:, 20:, enabled] == 0)
    assert np.all(np.ptp(run.actions[drops], axis=1) == 0)  # the pose is held until then
    volts = run.inputs[:, :, supply]
    assert np.all(np.ptp(volts, axis=1) == 0) and np.ptp(volts) > 0.5 * (table.high - table.low)
    assert volts.min() >= table.low and volts.max() <= table.high


MISSING = {
    "keyframe 'hme' is not in the model; expected one of 'home'.": (
        ('keyframe = "home"', 'keyframe = "hme"'),
    ),
    "action 'wrist/target' is not in the model": (
        ('name = "shoulder/target"', 'name = "wrist/target"'),
        ('joint = "shoulder"', 'joint = "*"'),
    ),
}


@pytest.mark.parametrize("said", MISSING)
def test_commands_for_what_the_model_does_not_have_are_refused(said: str, write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(*MISSING[said]))
    with pytest.raises(RobotError, match=said):
        excitation(robot, seed=0)


def test_targets_keep_to_the_joint_where_the_action_has_no_range(write_robot: Callable[..., Path]):
    """A shoulder with stops at 120 degrees, and without any about a pose of 4 rad."""
    unranged = ("low = -2.0\nhigh = 2.0\n", "")
    run = excitation(load_robot(write_robot(unranged)), seed=0)
    assert 1.0 < np.abs(run.actions[..., 0]).max() <= np.deg2rad(120)
    assert np.nanmax(np.abs(run.initial[..., 0])) <= np.deg2rad(120)
    free = ARM_XML.replace('range="-120 120" limited="true"', "").replace('qpos="0.3', 'qpos="4')
    told = excitation(load_robot(write_robot(unranged, xml=free)), seed=0).actions[..., 0]
    assert np.all(np.abs(told - 4.0) <= 3.2) and np.ptp(told) > 2.0

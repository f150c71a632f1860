"""Candidate commands: within the limits, from the reset pose, the same again, moving what they should."""

from pathlib import Path

import numpy as np
import pytest
from changed_robot import changed

from dynreg.excite.candidates import both, pool
from dynreg.excite.limits import BEYOND, Limits, joint_range, reached_by
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import reset_pose
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

ROBOTS = ("servo_pendulum", "leg", "quadruped", "so101", "simple_pendulum", "emps")
STEPS = 60
KNEE = """[[drives]]
joint = "knee"
type = "position"
gain = 40.0
enable = "knee/enabled"

"""
HINGE = '<joint name="pivot" type="hinge"'


@pytest.mark.parametrize("name", ROBOTS)
def test_commands_keep_to_limits_and_rates(name: str) -> None:
    robot = load_robot(name)
    limits = Limits.of(robot)
    run = pool(robot, limits, (), STEPS, 0).run
    assert (run.actions >= limits.low).all() and (run.actions <= limits.high).all()
    first = np.tile(reset_pose(robot), (run.episodes, 1, 1))
    change = np.diff(np.concatenate([first, run.actions], axis=1), axis=1)
    assert (np.abs(change) <= limits.rate / robot.rate * (1 + 1e-9)).all()


def test_limits_are_those_of_actions_joints_and_drives() -> None:
    servo, leg = (Limits.of(load_robot(name)) for name in ("servo_pendulum", "leg"))
    assert (servo.low[0], servo.high[0]) == (-3.1416, 3.1416)
    assert servo.rate[0] == pytest.approx(7.4 / 0.35)  # a duty servo's no-load speed: supply / kt
    robot = load_robot("leg")
    for a, action in enumerate(robot.file.actions):
        stops = robot.model.joint(action.name.split("/")[0]).range
        assert leg.low[a] == max(action.low, stops[0]) and leg.high[a] == min(action.high, stops[1])
    np.testing.assert_array_equal(leg.rate, 12.0)
    assert np.isinf(Limits.of(load_robot("simple_pendulum")).rate).all(), "a torque may jump"


def test_a_jump_is_slowed_down_and_still_arrives() -> None:
    limits = Limits(np.array([-1.0]), np.array([1.0]), np.array([2.0]))
    kept = limits.keep(np.full((20, 1), 5.0), np.zeros(1), 0.1)[:, 0]
    np.testing.assert_allclose(kept[:5], [0.2, 0.4, 0.6, 0.8, 1.0])
    assert (kept[5:] == 1.0).all()


def test_the_same_seed_gives_the_same_commands() -> None:
    robot = load_robot("leg")
    limits = Limits.of(robot)
    first, again, other = (pool(robot, limits, (), STEPS, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.run.actions, again.run.actions)
    assert first.names == again.names == other.names
    assert (first.run.actions != other.run.actions).any()


def test_joints_that_are_not_named_hold_still() -> None:
    robot = load_robot("leg")
    run = pool(robot, Limits.of(robot), ("knee",), STEPS, 0).run
    still = [a for a, name in enumerate(robot.actions) if not name.startswith("knee")]
    np.testing.assert_array_equal(run.actions[..., still] - reset_pose(robot)[still], 0.0)
    assert np.ptp(run.actions[..., 2], axis=1).max() > 0.5


def test_drives_are_switched_off_only_where_a_candidate_drops() -> None:
    robot = load_robot("servo_pendulum")
    made = pool(robot, Limits.of(robot), (), STEPS, 0)
    enabled = made.run.inputs[..., robot.inputs.index("arm/enabled")]
    for name, on in zip(made.names, enabled, strict=True):
        assert (on[: STEPS // 2] == 1.0).all()
        assert (on[STEPS // 2 :] == (0.0 if name.startswith("drop") else 1.0)).all()


def test_only_drives_of_joints_that_move_are_switched_off(tmp_path: Path) -> None:
    """The leg's drives have one switch: dropped with its knee, the hip would fall, too."""
    for name, robot in (
        ("one", load_robot("leg")),
        ("own", changed(tmp_path / "own", "leg", {"[[drives]]\n": f"{KNEE}[[drives]]\n"})),
    ):
        made = pool(robot, Limits.of(robot), ("knee",), STEPS, 0)
        off = [(one == 0.0).any(axis=0) for one in made.run.inputs]
        drops = [one for one in made.names if one.startswith("drop")]
        assert bool(drops) == (name == "own") and sum(one.any() for one in off) == len(drops)
        for one in off:
            assert not one[[i for i, given in enumerate(robot.inputs) if given != "knee/enabled"]].any()


def test_a_joint_that_runs_into_its_stop_is_not_followed(tmp_path: Path) -> None:
    """The stop holds it within a fiftieth of its range, whether it comes fast or slowly."""
    robot = changed(tmp_path / "arm", "simple_pendulum", {}, {HINGE: f'{HINGE} range="-30 30"'})
    period, steps = 1.0 / robot.rate, round(12.0 * robot.rate)
    hard, soft = np.full((1, steps, 1), 2.0), np.linspace(0.0, 1.8, steps)[None, :, None]
    for told, usable in ((hard, False), (soft, True)):
        made = rollout(robot, robot.space.nominal[None], Run(told, period=period))
        found, reached = reached_by(robot, made.states, made.fell, period)
        low, high = joint_range(robot, robot.channels[0])
        assert high < reached[0, 1, 0] < high + BEYOND * (high - low) and found == [usable]


def test_settings_are_crossed_and_pools_joined() -> None:
    robot = load_robot("servo_pendulum")
    made = pool(robot, Limits.of(robot), (), STEPS, 0).take(np.array([3, 0]))
    settings = np.array([[100.0, 0.0], [800.0, 0.15]])
    crossed = made.with_settings(settings)
    assert len(crossed) == 4 and crossed.names == tuple(np.repeat(made.names, 2))
    np.testing.assert_array_equal(crossed.run.settings, np.tile(settings, (2, 1)))
    whole = both(made, crossed)
    np.testing.assert_array_equal(whole.run.actions[2:], np.repeat(made.run.actions, 2, axis=0))
    assert whole.names == made.names + crossed.names


def test_a_joint_range_is_its_channels_and_its_stops() -> None:
    assert joint_range(load_robot("servo_pendulum"), "arm/position") == (-6.2832, 6.2832)
    assert joint_range(load_robot("servo_pendulum"), "arm/velocity") == (-np.inf, np.inf)
    robot = load_robot("leg")
    low, high = joint_range(robot, "knee/position")
    stops = robot.model.joint("knee").range
    assert stops[0] <= low < high <= stops[1]

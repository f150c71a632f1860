"""Hidden causes of a base on two wheels: found by name, none where none is; and what a start that is measured says."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose.signals import joint_signals, joints_of_actions
from dynreg.diagnose.threshold import USUAL, Threshold
from dynreg.diagnose.trial import Trial, Trials
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.cut import windows
from dynreg.replay.repeatability import repeatability
from dynreg.replay.windows import STILL, standing, starts
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.trials import results_of


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


def test_a_hidden_cause_is_found_and_no_other(robot: Robot):
    """The truth runs on the unicycle engine, the diagnosis on the kinematic one; 20 nats are asked for."""
    trials = Trials(robot, protocol(robot, seed=1, seconds=25.0), threads=1)
    hidden = ["wheel_gain", "drive_inertia", "wheel_slip", None]
    todo = [Trial((term(effect),) if effect else (), "medium", 1) for effect in hidden]
    found = results_of(trials, todo, Threshold(USUAL, ()), share=False)
    assert [one.named for one in found] == hidden and all(one.right for one in found)
    assert all(one.parameter_error is None or one.parameter_error < 0.2 for one in found)


def test_a_base_that_stands_still_at_first_is_measured_many_times(robot: Robot):
    rng = np.random.default_rng(0)
    noise = np.array([max(c.noise, c.quantum) for c in robot.file.channels])
    truth = np.array([1.0, 2.0, 0.0, 0.0, 0.3, -0.2, 0.7])
    measured = truth + noise * rng.standard_normal((4, 41, len(truth)))
    actions = np.zeros((4, 40, 2))
    actions[0, 25:] = 3.0
    actions[1, 0] = 3.0  # moves at once
    actions[2, 10:] = 3.0
    measured[2, 4:, 4] += 4 * STILL * noise[4]  # rolls without a command
    actions[3, 25:] = 3.0
    measured[3, 7, 5] = np.nan
    np.testing.assert_array_equal(standing(robot, actions, measured), [26, 1, 1, 26])
    begun = starts(robot, actions, measured)
    np.testing.assert_array_equal(begun[1:3], measured[1:3, 0])
    np.testing.assert_allclose(begun[0], measured[0, :26].mean(axis=0), rtol=1e-12)
    assert np.abs((begun[0] - truth) / noise).max() < 4 / np.sqrt(26)
    assert begun[3, 5] == pytest.approx(np.nanmean(measured[3, :26, 5]))  # of those that there are
    assert begun[3, 4] == pytest.approx(measured[3, :26, 4].mean())
    servo = load_robot("servo_pendulum")
    rows = rng.standard_normal((2, 5, len(servo.channels)))
    np.testing.assert_array_equal(starts(servo, np.zeros((2, 4, 1)), rows), rows[:, 0])


def test_runs_of_a_base_part_from_their_common_start(robot: Robot):
    """Its floor is what two runs of the same commands differ by, counted from where they stood: more than the noise."""
    plan = protocol(robot, seed=0, seconds=25.0)
    recording = log_of(robot, hide(robot, (), None, 3), plan)
    by_name = {r.channel: r for r in repeatability(robot, recording)}
    yaw, wheel = by_name["base/yaw"], by_name["left_wheel/position"]
    assert yaw.pairs == 4 and yaw.spread > 1.1 * yaw.stated
    episodes = [e.values[:, recording.names.index("left_wheel/position")] for e in recording.episodes[:8]]
    apart = [a - b for a, b in zip(episodes[:4], episodes[4:], strict=True)]
    expected = np.sqrt(np.mean([np.mean((d - d[:26].mean()) ** 2) for d in apart]) / 2)
    assert wheel.spread == pytest.approx(expected, rel=0.01)


def test_numbers_that_are_missing_at_first_do_not_stretch_the_rest(robot: Robot):
    """A base that moves after 26 rows still parts from where it stood, if the first numbers of a channel are lost."""
    plan = protocol(robot, seed=0, seconds=25.0)
    whole = log_of(robot, hide(robot, (), None, 3), plan)
    column = whole.names.index("left_wheel/position")
    episodes = []
    for e in whole.episodes:
        values = e.values.copy()
        values[:16, column] = np.nan
        episodes.append(replace(e, values=values))
    cut = replace(whole, episodes=tuple(episodes))
    spread = next(r for r in repeatability(robot, cut) if r.channel == "left_wheel/position").spread
    runs = [e.values[16:, column] for e in whole.episodes[:8]]
    apart = [a - b for a, b in zip(runs[:4], runs[4:], strict=True)]
    expected = np.sqrt(np.mean([np.mean((d - d[:10].mean()) ** 2) for d in apart]) / 2)
    assert spread == pytest.approx(expected, rel=0.01)


def test_wheels_are_joints_with_a_position_and_a_velocity(robot: Robot):
    recording = log_of(robot, hide(robot, (), None, 3), protocol(robot, seed=1, seconds=12.5))
    cut = windows(robot, recording)
    found = joint_signals(robot, cut)
    assert list(found) == ["left_wheel", "right_wheel"]
    for i, signals in enumerate(found.values()):
        np.testing.assert_array_equal(signals.position, cut.measured[:, :-1, i])
        np.testing.assert_array_equal(signals.velocity, cut.measured[:, :-1, 2 + i])
    assert list(joints_of_actions(load_robot("husky"))) == ["base/speed", "base/yaw_rate"]

"""What a joint was doing is read off the log and the nominal servo law."""

import numpy as np
import pytest
from motions import swing, windows_of

from dynreg.diagnose.signals import joint_of_channel, joint_signals
from dynreg.sim.robot import Robot, load_robot

KT, OHM, DUTY, SUPPLY = 0.35, 4.5, 0.002877, 7.4  # of robot.toml


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def test_torque_follows_the_duty_law_under_the_settings_and_inputs_of_the_log(robot):
    measured = swing(41)[None].repeat(3, axis=0)
    actions = measured[:, :-1, :1] + np.array([0.05, 0.5, -0.3])[:, None, None]
    inputs = np.tile(robot.input_defaults, (3, 40, 1))
    inputs[2, :, 0], inputs[2, 30:, 1] = 6.0, 0.0
    settings = np.tile([s.nominal for s in robot.file.settings], (3, 1))
    settings[:, robot.settings.index("kp")] = gain = np.array([400.0, 800.0, 800.0])
    arm = joint_signals(robot, windows_of(robot, measured, actions, inputs=inputs, settings=settings))["arm"]
    duty = np.clip(DUTY * gain[:, None] * np.array([[0.05], [0.5], [-0.3]]), -1, 1)
    supply = np.array([[SUPPLY], [SUPPLY], [6.0]])
    torque = KT / OHM * (duty * supply - KT * measured[:, :-1, 1])
    torque[2, 30:] = 0.0
    np.testing.assert_allclose(arm.torque, torque, atol=1e-12)
    np.testing.assert_allclose(arm.command_error, actions[..., 0] - measured[:, :-1, 0], atol=1e-12)
    assert not arm.saturated[[0, 2]].any() and arm.saturated[1].all()
    assert arm.enabled[:2].all() and not arm.enabled[2, 30:].any() and arm.enabled[2, :30].all()


def test_a_velocity_that_was_not_logged_is_the_slope_of_the_position(robot):
    whole = swing(101)[None]
    bare = whole.copy()
    bare[..., 1] = np.nan
    patchy = whole.copy()
    patchy[:, ::3, 1] = np.nan
    actions = np.zeros((1, 100, 1))
    told = [joint_signals(robot, windows_of(robot, m, actions))["arm"] for m in (whole, bare, patchy)]
    np.testing.assert_array_equal(told[0].velocity, whole[:, :-1, 1])
    for other in told[1:]:
        np.testing.assert_allclose(other.velocity[:, 1:], told[0].velocity[:, 1:], atol=0.01)
    assert told[0].velocity_noise == pytest.approx(np.hypot(0.02, 0.024 / np.sqrt(12)))
    assert told[1].velocity_noise == pytest.approx(
        np.hypot(0.0005, 0.001534 / np.sqrt(12)) / np.sqrt(2) / 0.01
    )


def test_a_torque_drive_has_no_command_error_and_needs_no_position():
    robot = load_robot("simple_pendulum")
    measured = np.full((1, 21, 2), np.nan)
    measured[..., 1] = 0.5
    actions = np.linspace(-8, 8, 20).reshape(1, 20, 1)
    pivot = joint_signals(robot, windows_of(robot, measured, actions))["pivot"]
    np.testing.assert_allclose(pivot.torque[0], np.clip(actions[0, :, 0], -6, 6))  # the action's range
    assert np.isnan(pivot.command_error).all() and not pivot.saturated.any()
    np.testing.assert_array_equal(pivot.load, np.abs(pivot.torque))


def test_a_base_that_follows_velocities_is_at_its_limit_at_the_end_of_the_range():
    robot = load_robot("husky")
    measured = np.full((1, 5, len(robot.channels)), 0.2)
    actions = np.array([[[0.5, 0.1], [1.0, 0.1], [3.0, -2.0], [0.0, 0.0]]])
    told = joint_signals(robot, windows_of(robot, measured, actions, period=0.1))
    assert list(told) == ["base/speed", "base/yaw_rate"]
    np.testing.assert_array_equal(told["base/speed"].saturated[0], [False, True, True, False])
    np.testing.assert_array_equal(told["base/yaw_rate"].saturated[0], [False, False, True, False])
    np.testing.assert_allclose(told["base/speed"].command_error[0], [0.3, 0.8, 0.8, -0.2])
    np.testing.assert_allclose(told["base/speed"].load[0], [0.3, 0.8, 0.8, 0.2])
    assert joint_of_channel("base/speed", told) == "base/speed"


def test_channels_of_a_floating_base_belong_to_no_joint():
    robot = load_robot("quadruped")
    measured = np.zeros((1, 4, len(robot.channels)))
    told = joint_signals(robot, windows_of(robot, measured, np.zeros((1, 3, 12))))
    assert len(told) == 12
    assert joint_of_channel("fl_hip/velocity", told) == "fl_hip"
    assert joint_of_channel("base/roll", told) is None

"""What needs no simulator: a robot that holds still, and joints that follow their commands with a lag."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.baselines import LAGS, followed, held
from dynreg.replay.cut import windows
from dynreg.sim.robot import load_robot


@pytest.fixture(scope="module")
def servo():
    robot = load_robot("servo_pendulum")
    return robot, windows(robot, log_of(robot, hide(robot, (), None, 5), protocol(robot, seconds=12.5)))


def test_a_robot_that_holds_still_stays_where_it_was_and_has_no_speed(servo):
    robot, cut = servo
    still = held(robot, cut)
    assert still.shape == cut.measured.shape
    assert np.array_equal(still[:, -1, 0], cut.measured[:, 0, 0]) and not still[..., 1].any()


def test_joints_follow_their_commands_with_the_lag_that_errs_least(servo):
    robot, cut = servo
    every = np.arange(len(cut))
    led = followed(robot, cut, every)
    assert np.isnan(led[..., 1]).all(), "nothing is said of speeds"
    error = np.nanmean(np.abs(led[..., 0] - cut.measured[..., 0]))
    assert error < 0.8 * np.nanmean(np.abs(held(robot, cut)[..., 0] - cut.measured[..., 0]))
    at_once = np.concatenate([cut.measured[:, :1, 0], cut.run.actions[..., 0]], axis=1)
    assert error < np.nanmean(np.abs(at_once - cut.measured[..., 0])) and LAGS[0] == 0.0


def test_drives_that_are_told_no_positions_follow_nothing():
    robot = load_robot("diffdrive")
    cut = windows(robot, log_of(robot, hide(robot, (), None, 5), protocol(robot, seconds=12.5)))
    assert np.isnan(followed(robot, cut, np.arange(len(cut)))).all()
    assert np.isfinite(held(robot, cut)).any()


def test_what_is_not_measured_at_a_windows_start_holds_its_first_value(servo):
    robot, cut = servo
    late = replace(cut, measured=cut.measured.copy())
    late.measured[:, 0, 0] = np.nan
    assert np.array_equal(held(robot, late)[:, -1, 0], cut.measured[:, 1, 0])
    late.measured[..., 0] = np.nan
    assert np.isnan(followed(robot, late, np.arange(len(cut)))[..., 0]).all()

"""A log with a row for each command: the noise of the pose that each window begins with is no missing cause."""

from pathlib import Path

import numpy as np
import pytest
from timed_khepera import NOISE, timed_folder, timed_log

from dynreg import session
from dynreg.diagnose.verdict import begin_noise
from dynreg.replay.cut import windows
from dynreg.replay.windows import Replayer
from dynreg.sim.robot import Robot, load_robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(timed_folder(tmp_path_factory.mktemp("timed"), horizon=10.0))


def test_what_the_noise_of_the_first_pose_makes_of_a_path(robot: Robot) -> None:
    """Of the true simulator nothing is left but the noise of each row and what that of the first one became."""
    cut = windows(robot, timed_log(robot, 600, noise=1.0))
    (states,) = Replayer(robot, cut).states(robot.space.nominal[None], np.arange(len(cut)))
    left = np.sqrt(np.nanmean((states - cut.measured)[:, 1:] ** 2, axis=(0, 1)))
    expected = np.hypot(robot.sensor_noise, begin_noise(robot, cut))
    assert left == pytest.approx(expected, rel=0.3)
    assert (expected[:2] > 1.5 * NOISE[:2]).all() and expected[2] == pytest.approx(
        np.sqrt(2) * NOISE[2], rel=0.01
    )


def test_robots_without_a_pose_have_none() -> None:
    servo = load_robot("servo_pendulum")
    assert not begin_noise(servo, None).any()


def test_a_slower_drive_is_a_parameter_and_no_cause_is_missing(robot: Robot, tmp_path: Path) -> None:
    with session.open(tmp_path / "registry") as opened:
        log = opened.ingest(timed_log(robot, 200, noise=1.0, speed_lag=0.13), robot.folder, name="drive")
        found = opened.diagnose(log, effects=["wheel_gain", "command_delay"], threshold_runs=0)
    assert found.verdict == "none" and not found.causes
    lag = found.parameters["speed_lag"]
    assert abs(lag.value - 0.13) < 0.01 and lag.pulled_sigma > 3

"""A log of one run, shorter than the longest rollout: the error says a horizon with which it can be diagnosed."""

import re

import pytest
import secret_servo

from dynreg.data.recording import Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import LogError
from dynreg.sim.robot import Robot, load_robot


def one_run(robot: Robot, seconds: float) -> Recording:
    return secret_servo.record(robot.space.nominal, 1, episodes=1, steps=round(seconds * robot.rate))


@pytest.mark.parametrize("seconds", [8.0, 3.0])
def test_the_horizon_that_is_advised_makes_rollouts_enough(seconds: float):
    robot = load_robot("servo_pendulum")
    recording = one_run(robot, seconds)
    with pytest.raises(LogError, match="makes 1 rollout of") as error:
        pose(robot, recording, DiagnosisOptions(threads=1, horizon=10.0))
    told = re.search(r"--horizon (\S+) \(the longest episode lasts (\S+) s\)", error.value.do)
    assert float(told[2]) == pytest.approx(seconds, rel=0.02)
    _, data = pose(robot, recording, DiagnosisOptions(threads=1, horizon=float(told[1])))
    assert data.parts.fit.any() and data.parts.select.any() and data.parts.test.any()


def test_of_a_log_of_some_rows_a_longer_one_is_asked_for():
    robot = load_robot("servo_pendulum")
    with pytest.raises(LogError) as error:
        pose(robot, one_run(robot, 0.08), DiagnosisOptions(threads=1, horizon=10.0))
    assert error.value.do == "record longer, or more episodes"

"""Which feet are down follows from the measured pose."""

import numpy as np
import pytest
from motions import swing, windows_of

from dynreg.diagnose.stance import stance
from dynreg.sim.robot import Robot, load_robot

STANCE = np.tile([0.12, 0.75, -1.5, -0.12, 0.75, -1.5], 2)  # the model's keyframe


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("quadruped")


def standing(robot: Robot, rows: int = 4) -> np.ndarray:
    measured = np.zeros((1, rows, len(robot.channels)))
    measured[..., :12] = STANCE
    return measured


def feet(robot: Robot, measured: np.ndarray) -> dict[str, np.ndarray] | None:
    shape = (measured.shape[0], measured.shape[1] - 1, len(robot.actions))
    return stance(robot, windows_of(robot, measured, np.zeros(shape)))


def test_all_feet_are_down_in_the_stance_and_a_bent_leg_is_up(robot):
    measured = standing(robot)
    measured[0, 1:, robot.channels.index("fr_elbow/position")] = -2.0
    found = feet(robot, measured)
    assert list(found) == [a.split("/")[0] for a in robot.actions]
    for joint, down in found.items():
        expected = [1.0, 0.0, 0.0] if joint.startswith("fr_") else [1.0, 1.0, 1.0]
        np.testing.assert_array_equal(down[0], expected)


@pytest.mark.parametrize(
    ("channel", "angle", "down"),
    [("base/roll", 0.2, "r"), ("base/roll", -0.2, "l"), ("base/pitch", 0.2, "f"), ("base/pitch", -0.2, "r")],
)
def test_a_tilted_robot_stands_on_its_lower_side(robot, channel, angle, down):
    """Roll about x to the right, pitch about y to the front, as the base's channels are defined."""
    measured = standing(robot)
    measured[..., robot.channels.index(channel)] = angle
    side = 1 if channel == "base/roll" else 0
    for joint, on in feet(robot, measured).items():
        assert (on == (joint[side] == down)).all(), joint


def test_rows_without_a_pose_are_not_known(robot):
    measured = standing(robot)
    measured[0, 1, 3] = np.nan
    found = feet(robot, measured)["rl_hip"][0]
    np.testing.assert_array_equal(found, [1.0, np.nan, 1.0])


def test_without_a_floating_base_or_its_tilt_nothing_is_said(robot):
    bench = load_robot("servo_pendulum")
    assert feet(bench, swing(5)[None]) is None
    assert feet(load_robot("husky"), np.zeros((1, 5, 2))) is None
    measured = standing(robot)
    measured[..., robot.channels.index("base/roll")] = np.nan
    assert feet(robot, measured) is None

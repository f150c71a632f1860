"""What commands keep to: the reset pose inside the limits, and patterns where a joint has room."""

from pathlib import Path

import numpy as np
import pytest
from changed_robot import changed

from dynreg.errors import RobotError
from dynreg.excite.candidates import pool
from dynreg.excite.limits import INSIDE, Limits
from dynreg.sim.excitation import FREE, excitation, reset_pose
from dynreg.sim.robot import load_robot

STEPS = 400  # at 100 Hz: a slow triangle goes once to and fro
ELBOW = "low = -2.4\nhigh = 2.4"
DRIVE = "torque_limit = 6.0\n"


def test_a_reset_pose_outside_the_limits_is_refused(tmp_path: Path) -> None:
    robot = changed(tmp_path / "arm", "two_joint_arm", {ELBOW: "low = -2.4\nhigh = -0.1"})
    with pytest.raises(
        RobotError, match=r"'elbow/target'.* 0 rad in the reset pose.*-2.4 to -0.1 rad.*\[reset\]"
    ):
        Limits.of(robot)


def test_a_reset_pose_that_was_rounded_is_inside_and_the_rate_is_kept_from_the_limit(tmp_path: Path) -> None:
    file = {ELBOW: "low = -2.4\nhigh = -0.001", DRIVE: f"{DRIVE}speed_limit = 1.5\n"}
    robot = changed(tmp_path / "arm", "two_joint_arm", file)
    limits = Limits.of(robot)
    assert limits.rate[1] == 1.5
    actions = pool(robot, limits, (), STEPS, 0).run.actions[..., 1]
    assert actions.max() <= -0.001 and actions.min() < -1.0
    assert np.abs(np.diff(actions, axis=1)).max() <= 1.5 / robot.rate


def test_targets_without_limits_reach_as_far_as_in_a_population(tmp_path: Path) -> None:
    robot = changed(tmp_path / "arm", "two_joint_arm", {ELBOW: ""})
    actions = pool(robot, Limits.of(robot), (), STEPS, 0).run.actions[..., 1]
    assert np.abs(actions).max() == pytest.approx(0.9 * INSIDE * FREE["rad"])
    bank = excitation(robot, seed=0, steps=STEPS, sizes=(9.0, 9.0))
    assert np.abs(bank.actions[..., 1]).max() == FREE["rad"]


def test_a_joint_that_rests_at_an_end_of_its_range_moves_about_the_middle(tmp_path: Path) -> None:
    file = {ELBOW: "low = 0.0\nhigh = 2.4", DRIVE: f"{DRIVE}speed_limit = 6.0\n"}
    robot = changed(tmp_path / "arm", "two_joint_arm", file)
    limits = Limits.of(robot)
    made = pool(robot, limits, ("elbow",), STEPS, 0)
    actions = made.run.actions
    assert (actions[..., 0] == reset_pose(robot)[0]).all()
    by_name = dict(zip(made.names, actions[..., 1], strict=True))
    wide = by_name["triangle of 4 s, reach 0.9"]
    assert wide.min() < 0.2 and wide.max() > 2.2
    # from when they are there to when they go back: a period
    above, below = (by_name[f"triangle of 2 s, reach 0.2, around {centre}"] for centre in ("+0.5", "-0.5"))
    assert above[100:300].mean() == pytest.approx(1.2 + 0.57, abs=0.05)
    assert below[100:300].mean() == pytest.approx(1.2 - 0.57, abs=0.05) and np.ptp(below[100:300]) > 0.4
    from_pose = np.concatenate([np.zeros((len(actions), 1)), actions[..., 1]], axis=1)
    assert np.abs(np.diff(from_pose, axis=1)).max() <= 6.0 / robot.rate, (
        "the rate is kept from the reset pose on"
    )


@pytest.mark.parametrize("name", ["emps", "diffdrive", "simple_pendulum"])
def test_torques_and_speeds_have_no_patterns_away_from_zero(name: str) -> None:
    robot = load_robot(name)
    made = pool(robot, Limits.of(robot), (), round(4 * robot.rate), 0)
    assert not [one for one in made.names if "around" in one or one.startswith("drop")]
    waves = [one for one in made.names if one.startswith(("triangle", "holds")) and "apart" not in one]
    middle = made.run.actions[[made.names.index(one) for one in waves]].mean(axis=1)
    assert np.abs(middle).max() < 0.01

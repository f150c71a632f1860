"""Sentences for the operator of an experiment: what no limit bounds."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.excite.candidates import pool
from dynreg.excite.limits import Limits
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.verbs.cautions import beginning, cautions, ending, largest_steps

STEPS = 100
UNCHECKED = (
    "collisions of links with each other and their surroundings are not checked: play the commands slowly first, with"
    " a hand at the stop"
)


def told(robot: Robot, reached: tuple[float, float] = (-0.5, 1.25)) -> str:
    """All cautions about the candidates for a robot, whose states are expected to reach this far."""
    limits = Limits.of(robot)
    ends = np.tile(np.array(reached)[None, :, None], (1, 1, len(robot.channels)))
    return ". ".join(cautions(robot, limits, pool(robot, limits, (), STEPS, 0).run, ends))


def test_a_robot_with_all_its_limits_needs_no_more_than_the_one_about_collisions() -> None:
    assert told(load_robot("so101")) == UNCHECKED


def test_torques_are_not_to_be_played_slowly() -> None:
    """Held for longer, they drive a joint further."""
    said = told(load_robot("simple_pendulum"))
    assert said.startswith("collisions of links with each other") and "keep a hand at the stop" in said
    assert "slowly" not in said


def test_drives_that_are_switched_off_are_named() -> None:
    robot = load_robot("leg")
    drops = [i for i, name in enumerate(pool(robot, Limits.of(robot), (), STEPS, 0).names) if "drop" in name]
    where = ", ".join(map(str, drops))
    assert told(robot) == (
        f"{UNCHECKED}. the drives of hip_roll, hip_pitch, knee are switched off halfway through {where}: keep clear"
        " of what swings and falls then"
    )


def test_a_carriage_without_stops_is_told_how_far_it_goes() -> None:
    said = told(load_robot("emps"))
    assert "no stops are known of slider (expected from -0.5 to 1.25 m)" in said and "range" in said


def test_drives_without_a_speed_limit_are_told_their_largest_step() -> None:
    robot = load_robot("six_joint_arm")
    run = pool(robot, Limits.of(robot), (), STEPS, 0).run
    said = told(robot)
    names = "base, shoulder, elbow, wrist_1, wrist_2, wrist_3"
    assert (
        f"no speed limit of {names} is known: the largest step is {largest_steps(robot, run).max():.3g} rad"
        in said
    )
    assert "give speed_limit" in said


def test_the_first_step_is_from_the_reset_pose_and_the_last_to_rest() -> None:
    pendulum, arm = load_robot("simple_pendulum"), load_robot("two_joint_arm")
    assert largest_steps(pendulum, Run(np.full((1, 3, 1), 2.0), period=0.01)) == pytest.approx([2.0])
    assert largest_steps(pendulum, Run(np.array([[[0.5], [1.0], [1.5]]]), period=0.01)) == pytest.approx(
        [1.5]
    )
    assert largest_steps(arm, Run(np.full((1, 3, 2), 0.7), period=0.01)) == pytest.approx([0.7, 0.7])


def test_commands_without_limits_and_bases_are_told() -> None:
    robot = load_robot("simple_pendulum")
    free = [a.model_copy(update={"low": None, "high": None}) for a in robot.file.actions]
    robot = replace(robot, file=robot.file.model_copy(update={"actions": free}))
    assert "no limits are known of pivot/torque (from -" in told(robot)
    assert (
        told(load_robot("create"))
        == "keep the floor free: expected are base/x from -0.5 to 1.25 m, base/y from -0.5 to 1.25 m"
    )
    assert told(load_robot("husky")) == "keep the floor free: no channel tells where the base goes"


def test_where_episodes_begin() -> None:
    assert beginning(load_robot("leg")) == "at rest in the reset pose, to which its targets return"
    assert beginning(load_robot("diffdrive")) == "at rest in the reset pose"


def test_how_episodes_end() -> None:
    assert ending(load_robot("leg")) == "the last row of each holds its targets"
    assert ending(load_robot("emps")) == "the last row of each sets all torques, voltages and speeds to 0"

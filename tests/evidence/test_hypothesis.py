"""Which sizes of effects are worth a name, and which effects no commands tell apart."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.evidence.hypothesis import Coordinates, Hypothesis, single_terms, worth_naming
from dynreg.sim.effects import one_group, term
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.sets import NO_LIMIT
from dynreg.sim.spec import TorqueDrive


@pytest.mark.parametrize(
    ("key", "own", "shared"),
    [
        ("asymmetric_friction", [1.0, 0.0], [0.05, 2.0]),
        ("stribeck_friction", [1.0, 0.0, 0.0], [0.05, 2.0, 0.0]),
        ("stribeck_load_friction", [0.0, 0.0, 1.0, 0.0], [0.05, 2.0, 0.05, 0.0]),
    ],
)
def test_what_a_simpler_effect_has_too_is_not_worth_the_name_of_the_larger_one(key, own, shared):
    hypothesis = Hypothesis((term(key),))
    assert worth_naming(hypothesis, np.array(own))
    assert not worth_naming(hypothesis, np.array(shared))


def test_an_exact_group_is_one_of_the_same_joint():
    leg, arm = load_robot("leg"), load_robot("servo_pendulum")
    assert one_group(leg, term("gravity_tilt"), term("encoder_offset[hip_roll]"))
    assert not one_group(leg, term("gravity_tilt"), term("encoder_offset[knee]"))
    assert not one_group(leg, term("force_offset[knee]"), term("asymmetric_friction[hip_roll]"))
    assert one_group(leg, term("force_offset[knee]"), term("asymmetric_friction[knee]"))
    assert one_group(arm, term("gravity_tilt"), term("com_offset"))
    assert not one_group(load_robot("quadruped"), term("gravity_tilt"), term("com_offset"))


@pytest.mark.parametrize(
    ("name", "about"),
    [("leg", ("hip_roll",)), ("double_pendulum", ("shoulder",)), ("so101", None), ("quadruped", None)],
)
def test_a_tilt_is_about_the_first_hinge_where_no_other_turns_it(name, about):
    robot = load_robot(name)
    tilt = term("gravity_tilt")
    assert tilt.effect.about(robot, ()) == about
    alike = [t.key for t in single_terms(robot) if t.key != tilt.key and one_group(robot, tilt, t)]
    assert alike == [f"encoder_offset[{joint}]" for joint in about or ()]


def without_limits(name: str) -> Robot:
    """A packaged robot whose drives state no torque limit."""
    robot = load_robot(name)
    drives = [d.model_copy(update={"torque_limit": NO_LIMIT}) for d in robot.file.drives]
    return replace(robot, file=robot.file.model_copy(update={"drives": drives}))


def test_sizes_go_by_the_torque_that_a_drive_without_a_limit_can_be_told():
    robot = without_limits("double_pendulum")
    torque = Coordinates(robot, np.full(len(robot.space), np.nan)).scales["torque"]
    assert torque.tolist() == [max(abs(a.low), abs(a.high)) for a in robot.file.actions]


def test_a_command_range_of_angles_is_no_torque():
    robot = without_limits("leg")
    torque = Coordinates(robot, np.full(len(robot.space), np.nan)).scales["torque"]
    told = [
        d.gain * max(abs(a.low), abs(a.high))
        for d, a in zip(robot.file.drives * 3, robot.file.actions, strict=True)
    ]
    assert (torque < 0.5 * np.array(told)).all()


def test_a_compliance_goes_by_the_joints_whose_drives_have_a_stiffness():
    """Beside a drive that is told a torque, its medium size was 1.9e7 rad/(N*m)."""
    robot = load_robot("two_joint_arm")
    first, second = robot.file.drives
    told = TorqueDrive(type="torque", joint=second.joint, torque_limit=second.torque_limit)
    mixed = replace(robot, file=robot.file.model_copy(update={"drives": [first, told]}))
    servo, other = mixed.joints
    keys = {t.key for t in single_terms(mixed, ("joint_elasticity", "viscous_friction"))}
    assert f"joint_elasticity[{servo}]" in keys and f"viscous_friction[{other}]" in keys
    assert f"joint_elasticity[{other}]" not in keys
    c, whole = (Coordinates(one, np.full(len(one.space), np.nan)) for one in (mixed, robot))
    size = term("joint_elasticity").effect.size
    alone = whole.scale(term(f"joint_elasticity[{servo}]"), size)
    assert c.scale(term("joint_elasticity"), size) == pytest.approx(alone)
    assert c.scale(term(f"joint_elasticity[{other}]"), size) == pytest.approx(alone)

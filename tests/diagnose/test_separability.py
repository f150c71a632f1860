"""Who is a neighbour: the effects that may be mistaken for one."""

from dynreg.diagnose.separability import neighbours
from dynreg.evidence.hypothesis import single_terms
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def test_neighbours_are_declared_by_either_effect_and_not_of_the_same_group():
    robot = load_robot("simple_pendulum")
    terms = single_terms(robot)
    assert {"coulomb_friction", "drive_gain", "inertia"} <= {
        t.key for t in neighbours(robot, term("payload"), terms)
    }
    assert "payload" in {t.key for t in neighbours(robot, term("drive_gain"), terms)}
    assert not {"com_offset", "encoder_offset"} & {
        t.key for t in neighbours(robot, term("gravity_tilt"), terms)
    }


def test_neighbours_on_several_joints_are_not_the_effect_itself_nor_of_the_group_of_its_joint():
    robot = load_robot("leg")
    terms = single_terms(robot)
    tilt = {t.key for t in neighbours(robot, term("gravity_tilt"), terms)}
    assert {"encoder_offset[knee]", "encoder_offset[hip_pitch]", "com_offset"} <= tilt
    assert not {"gravity_tilt", "encoder_offset[hip_roll]"} & tilt
    assert "encoder_offset" not in {t.key for t in neighbours(robot, term("encoder_offset[knee]"), terms)}
    play = {t.key for t in neighbours(robot, term("backlash[knee]"), terms)}
    assert "joint_elasticity[knee]" in play
    assert not {"joint_elasticity[hip_roll]", "backlash", "backlash[knee]", "backlash[hip_roll]"} & play


def test_the_same_on_another_body_is_a_neighbour():
    robot = load_robot("leg")
    near = {t.key for t in neighbours(robot, term("payload"), single_terms(robot))}
    assert "payload[shank]" in near and "payload" not in near
    elsewhere = {t.key for t in neighbours(robot, term("payload[shank]"), single_terms(robot))}
    assert "payload" in elsewhere and "payload[shank]" not in elsewhere

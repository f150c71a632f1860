"""Drives that a user states in place of the model's, and actuators of the model that no drive can be."""

from pathlib import Path

import numpy as np
import pytest
import strangers

from dynreg.draft.entry import Drafted
from dynreg.errors import DynregError, UsageError
from dynreg.sim.check import problems
from dynreg.sim.engines import rollout
from dynreg.sim.run import Run
from dynreg.verbs.robot_draft import RobotDraftSettings

GEARED = '<actuator><motor joint="shoulder" gear="100"/><motor joint="elbow" gear="100"/></actuator>'
MUSCLES = (
    '<actuator><muscle name="biceps" joint="elbow"/><muscle name="deltoid" joint="shoulder"/></actuator>'
)
MIXED = '<actuator><position joint="shoulder" kp="40" kv="1"/><motor joint="elbow" gear="5"/></actuator>'


def drafted(folder: Path, actuators: str, **stated) -> Drafted:
    path = folder / "arm.xml"
    path.write_text(strangers.ARM.format(actuators=actuators))
    return strangers.draft(path, "arm", **stated)


@pytest.mark.parametrize(
    "actuators, stated, said",
    [
        (GEARED, {"kd": 1.0}, "--kd 1"),
        (GEARED, {"kp": 5.0}, "--kp 5"),
        (GEARED, {"kp": 5.0, "drive": "torque"}, "--kp 5"),
        (strangers.CURRENT, {"kp": 5.0, "kd": 1.0}, "--kp 5"),
        (strangers.VELOCITY, {"kp": 5.0}, "--kp 5"),
    ],
    ids=[
        "a motor's rate gain",
        "a motor's gain",
        "a stated motor's gain",
        "a dcmotor's gain",
        "a speed's gain",
    ],
)
def test_a_gain_that_no_drive_has_is_refused(actuators, stated, said, tmp_path):
    with pytest.raises(DynregError) as refused:
        drafted(tmp_path, actuators, **stated)
    assert said in str(refused.value) and "--drive position" in str(refused.value)


def test_a_gain_that_some_drives_have_is_theirs_and_a_note_names_the_others(tmp_path):
    made = drafted(tmp_path, MIXED, kp=15.0)
    assert [(d.joint, d.type, d.gain) for d in made.robot.file.drives] == [
        ("shoulder", "position", 15.0),
        ("elbow", "torque", 5.0),
    ]
    assert any("--kp" in note and "elbow" in note for note in made.notes)


def test_gains_and_limits_are_stated_by_joint_or_glob(tmp_path):
    made = drafted(tmp_path, strangers.POSITION, kp={"*": 15.0, "elb*": 5.0}, torque_limit={"elbow": 7.0})
    shoulder, elbow = made.robot.file.drives
    before, _ = drafted(tmp_path, strangers.POSITION).robot.file.drives
    assert (shoulder.gain, elbow.gain) == (15.0, 5.0)
    assert (shoulder.torque_limit, elbow.torque_limit) == (before.torque_limit, 7.0)


def test_limits_that_differ_get_one_factor_as_their_parameter(tmp_path):
    """An absolute number for all joints would have made them alike."""
    made = drafted(tmp_path, strangers.POSITION, torque_limit={"shoulder": 20.0, "elbow": 7.0})
    (limit,) = (p for p in made.robot.file.parameters if p.name == "torque_limit")
    assert limit.sets == ["port.drive.torque_limit[*] *="] and limit.nominal == 1.0


@pytest.mark.parametrize("flag", ["kp", "kd", "torque_limit"])
def test_a_joint_that_no_drive_has_is_refused_with_the_names(flag, tmp_path):
    with pytest.raises(DynregError, match=r"no driven joint is called 'wrist'.*some of shoulder, elbow"):
        drafted(tmp_path, strangers.POSITION, **{flag: {"shoulder": 5.0, "wrist": 3.0}})


@pytest.mark.parametrize("text", ["", "fast", "elbow=", "elbow=-3", "0", "1,elbow", "elbow=nan"])
def test_what_states_no_number_is_refused(text):
    with pytest.raises(UsageError, match="a number above 0, for all joints or as JOINT=NUMBER"):
        RobotDraftSettings(kp=text)
    assert RobotDraftSettings(kp="1500,wrist*=300").stated("kp") == {"*": 1500.0, "wrist*": 300.0}
    assert RobotDraftSettings(kp=20.0).stated("kp") == 20.0


def test_a_motor_that_is_stated_to_be_one_keeps_its_gear(tmp_path):
    made = drafted(tmp_path, GEARED, drive="torque")
    (one,) = made.robot.file.drives
    assert one.gain == 100.0 and made.robot.actions == ("shoulder/command", "elbow/command")
    guessed = drafted(tmp_path, "", drive="torque")
    for mine, other in zip(made.robot.file.actions, guessed.robot.file.actions, strict=True):
        assert 100.0 * mine.high == pytest.approx(other.high)


def test_gains_of_the_model_stay_where_only_the_kind_is_stated(tmp_path):
    made = drafted(tmp_path, strangers.POSITION, drive="position")
    assert [d.gain for d in made.robot.file.drives] == [40.0, 20.0]
    assert "stated" not in made.files["robot.toml"].decode().split("[[actions]]")[0]


def test_drives_are_stated_for_a_model_whose_actuators_are_not_understood(tmp_path):
    with pytest.raises(DynregError) as refused:
        drafted(tmp_path, MUSCLES)
    assert "biceps" in str(refused.value) and "--drive position" in str(refused.value)
    made = drafted(tmp_path, MUSCLES, drive="position", kp=5.0)
    assert made.robot.actions == ("shoulder/target", "elbow/target")
    assert [d.gain for d in made.robot.file.drives] == [5.0, 5.0] and made.robot.model.nu == 2
    assert any("biceps" in note for note in made.notes) and problems(made.robot) == []


def test_names_that_the_model_has_given_elsewhere_are_no_obstacle(tmp_path):
    """An actuator that stays and is called as a driven joint, and a ground that touches nothing."""
    tendon = (
        '<tendon><fixed name="both"><joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon>'
        '<actuator><motor name="elbow" tendon="both"/><position name="x" joint="elbow" kp="20" kv="0.5"/></actuator>'
    )
    assert drafted(tmp_path, tendon).robot.actions == ("elbow/target",)
    dog = tmp_path / "dog.xml"
    ghost = '<worldbody><geom name="ground" type="plane" size="1 1 0.1" contype="0" conaffinity="0"/>'
    dog.write_text(strangers.quadruped().replace("<worldbody>", ghost))
    made = strangers.draft(dog, "dog", visuals=True)
    assert any("ground_2" in note for note in made.notes) and problems(made.robot) == []


def test_a_free_base_of_an_mjcf_is_refused(tmp_path):
    with pytest.raises(DynregError, match=r"--free-base.*<freejoint/>"):
        drafted(tmp_path, strangers.POSITION, free_base=True)
    with pytest.raises(DynregError, match=r"--fixed-base.*leave <freejoint/> out"):
        drafted(tmp_path, strangers.POSITION, free_base=False)


def test_a_velocity_drive_keeps_its_bias(tmp_path):
    """It was dropped: the drive turned by 3 rad/s less than the model's."""
    biased = (
        '<actuator><general joint="elbow" gainprm="0.5" biastype="affine" biasprm="0.3 0 -0.1"/></actuator>'
    )
    made = drafted(tmp_path, biased)
    text = made.files["robot.toml"].decode()
    assert "5 times the control of the model's actuator, plus 3" in text


def test_controls_that_nothing_clamps_have_no_range(tmp_path):
    clamped = drafted(tmp_path, strangers.MOTOR).robot.file.actions
    assert [a.high for a in clamped] == [1.0, 2.0]
    free = strangers.ARM.format(actuators=strangers.MOTOR).replace(
        "<worldbody>", '<option><flag clampctrl="disable"/></option><worldbody>', 1
    )
    (tmp_path / "free.xml").write_text(free)
    assert [a.high for a in strangers.draft(tmp_path / "free.xml", "free").robot.file.actions] == [None, None]


def test_a_stronger_motor_than_the_joint_states_is_stronger(tmp_path):
    """The joint's own limit (`effort` of a URDF) clipped it once more: half of a population's range did nothing."""
    path = tmp_path / "two_link.urdf"
    path.write_text(strangers.URDF)
    robot = strangers.draft(path, "two_link", kp=400.0, kd=1.0).robot
    run = Run(np.full((1, 15, 2), [1.0, 0.0]), initial=np.zeros((1, len(robot.channels))))
    limit = robot.space.names.index("torque_limit")
    values = np.tile(robot.space.nominal, (2, 1))
    values[1, limit] *= 1.4
    column = robot.channels.index("joint_a/position")
    usual, strong = rollout(robot, values, run, engine="mujoco").states[:, 0, :, column]
    assert strong[2] > 1.3 * usual[2]


def test_visual_parts_that_are_left_out_take_no_mass_along(tmp_path):
    """Where the model says that all masses are read off its geoms, they cannot go: that was a bug's traceback."""
    seen = '<geom type="box" size="0.1 0.1 0.1" pos="0.2 0 0" contype="0" conaffinity="0" mass="0.7"/>'
    text = strangers.ARM.format(actuators=strangers.POSITION)
    joint = text.index("<joint")
    path = tmp_path / "arm.xml"
    path.write_text(text[:joint] + seen + text[joint:])
    without, kept = strangers.draft(path, "arm"), strangers.draft(path, "arm", visuals=True)
    (said,) = (note for note in without.notes if "visual" in note)
    assert said.endswith("left out. All masses and inertias stay as they were; --visuals keeps it")
    for what in ("body_mass", "body_inertia"):
        left, all_of_it = (getattr(one.robot.model, what) for one in (without, kept))
        np.testing.assert_allclose(np.sort(left, axis=0), np.sort(all_of_it, axis=0), rtol=1e-5)
    at = text.index(">", text.index("<mujoco")) + 1
    path.write_text(path.read_text()[:at] + '<compiler inertiafromgeom="true"/>' + path.read_text()[at:])
    with pytest.raises(DynregError, match="visual parts of 'arm.xml' cannot be left out.*add --visuals"):
        strangers.draft(path, "arm")
    strangers.draft(path, "arm", visuals=True)

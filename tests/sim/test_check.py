import re
from collections.abc import Callable
from pathlib import Path

import pytest
from arm_robot import ARM_XML, parameter

from dynreg.folder import read_folder
from dynreg.sim.check import findings
from dynreg.sim.inspection import check_robot, inspect_robot
from dynreg.sim.robot import packaged_robots


@pytest.mark.parametrize("name", packaged_robots())
def test_packaged_robots_are_clean(name: str):
    assert inspect_robot(name) == []


def test_a_small_robot_is_clean(write_robot: Callable[..., Path]):
    assert check_robot(write_robot()) == []


XML_CHANGES = {
    "does not compile": ((), ("<mujoco", "<mujoc"), "model.xml: .*XML"),
    "no actuator": ((), ('<motor joint="elbow"/>', ""), "action 'elbow/torque': no actuator"),
}
CHANGES = {
    "channel": (('name = "elbow/velocity"', 'name = "elbw/velocity"'), "channel 'elbw/velocity'.*elbow"),
    "quantity": (('name = "elbow/velocity"', 'name = "elbow/speed"'), "'elbow/speed'.*elbow/velocity"),
    "action": (('name = "elbow/torque"', 'name = "wrist/torque"'), "action 'wrist/torque'.*elbow"),
    "no drive": (('joint = "elbow"', 'joint = "elbows"'), "no drive moves joint 'elbow'"),
    "idle drive": (
        ("[reset]", '[[drives]]\njoint = "w"\ntype = "torque"\n[reset]'),
        "drive 3.*moves no action",
    ),
    "wheels": (('type = "torque"\ngain = 0.5\ntorque_limit = 1.5', 'type = "velocity"'), "velocity drives"),
    "keyframe": (('keyframe = "home"', 'keyframe = "hme"'), "keyframe 'hme'.*home"),
    "setting": (("mj.body_mass[lower] +=", "mj.body_mass[lowr] +="), "setting 'added_mass'.*'lowr'.*lower"),
    "values": (("values = [0.0, 0.2, 0.4]\n", ""), "setting 'added_mass' has no `values`"),
    "unit": (('unit = "rad/s"', 'unit = "radian/s"'), "unit 'radian/s' of 'shoulder/velocity' is unknown"),
    "not SI": (('unit = "rad/s"', 'unit = "deg/s"'), "'deg/s'.*not SI; use 'rad/s'"),
    "other unit": (('unit = "rad/s"', 'unit = "m/s"'), "'m/s'.*not that of its joint; use 'rad/s'"),
    "factor": (('unit = "N*m/rad"', 'unit = "Nm/rad"'), "'Nm/rad' of 'gain'.*'Nm'"),
    "coarse": (("timestep = 0.002", "timestep = 0.05"), "timestep 0.05 s is longer than the 0.02 s"),
    "drop": (('"walk"]', '"drop"]'), "'drop'.*no drive has `enable`"),
    "fall": (("[reset]", "[fall]\ntilt = 1.0\n[reset]"), "free joint"),
    "joint engine": (('["mujoco"]', '["mujoco", "kinematic"]'), "kinematic engine: .*planar base"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_faults_beyond_loading_are_told_in_one_line(case: str, write_robot: Callable[..., Path]):
    """In this process: the folders differ in their robot.toml alone, whose model may be compiled here."""
    change, said = CHANGES[case]
    found = [str(one) for one in findings(read_folder(write_robot(change))) if one.severity == "error"]
    assert any(_matches(said, line) for line in found), found
    assert not any("\n" in line for line in found)


@pytest.mark.parametrize("case", XML_CHANGES)
def test_faults_of_the_model_are_told(case: str, write_robot: Callable[..., Path]):
    changes, (old, new), said = XML_CHANGES[case]
    assert old in ARM_XML
    found = check_robot(write_robot(*changes, xml=ARM_XML.replace(old, new)))
    assert any(_matches(said, line) for line in found), found


def test_all_faults_are_told_at_once(write_robot: Callable[..., Path]):
    wrong = parameter("a", "mj.body_mass[uper] =") + parameter(
        "b", "mj.body_mas[upper] =", "port.drive.gain[x] ="
    )
    folder = write_robot(
        ('name = "elbow/velocity"', 'name = "elbow/vel"'),
        ('keyframe = "home"', 'keyframe = "hme"'),
        parameters=wrong,
    )
    found = check_robot(folder)
    for said in ("elbow/vel", "hme", "'uper'", "body_mas ", "'x'"):
        assert sum(said in line for line in found) == 1, (said, found)


def test_what_all_engines_say_is_told_once(tmp_path: Path):
    source = packaged_robots()["servo_pendulum"]
    (tmp_path / "model.xml").write_text((source / "model.xml").read_text())
    text = (source / "robot.toml").read_text()
    assert 'engines = ["joint", "mujoco"]' in text
    (tmp_path / "robot.toml").write_text(
        text.replace("mj.body_mass[tip] =", "mj.body_mass[head] =").replace('"arm/velocity"', '"arm/speed"')
    )
    named = check_robot(tmp_path)
    assert len(named) == 2, named
    assert "line 42: channel 'arm/speed'" in named[0] and "parameter 'tip_mass'" in named[1]
    idle = text.replace('"mj.body_mass[tip] ="', '"port.drive.lag[arm] ="')
    assert idle != text
    (tmp_path / "robot.toml").write_text(idle)
    (line,) = check_robot(tmp_path)
    assert "parameter 'tip_mass' changes nothing" in line


def test_no_class_of_python_is_named(tmp_path: Path):
    (tmp_path / "robot.toml").write_text("robot = 3\n")
    lines = check_robot(tmp_path)
    assert "this should be a table" in lines[0] and not any("RobotTable" in line for line in lines)


def test_a_parameter_without_effect_is_named(write_robot: Callable[..., Path]):
    idle = parameter("idle", "port.drive.kt[elbow] =") + parameter("busy", "port.drive.gain[elbow] =")
    (line,) = check_robot(write_robot(parameters=idle))
    assert "'idle' changes nothing between 0.5 and 2" in line


def test_a_configuration_that_diverges_is_named(write_robot: Callable[..., Path]):
    wild = parameter("inertia", "mj.body_inertia[lower] *=", low=-30.0)
    found = check_robot(write_robot(parameters=wild))
    assert len(found) == 1 and _matches("'inertia' at -30 .* diverges at step 1", found[0]), found


def test_a_robot_that_cannot_stand_is_told(tmp_path: Path):
    source = packaged_robots()["quadruped"]
    (tmp_path / "model.xml").write_text((source / "model.xml").read_text())
    text = (source / "robot.toml").read_text()
    assert "height = 0.06" in text
    (tmp_path / "robot.toml").write_text(text.replace("height = 0.06", "height = 0.3"))
    (line,) = check_robot(tmp_path)
    assert "falls within 1 s of holding its reset pose" in line


def _matches(pattern: str, line: str) -> bool:
    return re.search(pattern, line) is not None


def test_a_base_that_the_model_names_otherwise_is_no_bug(tmp_path: Path):
    """Engines of wheeled robots move the base by their own equations; the model is for pictures."""
    source = packaged_robots()["husky"]
    (tmp_path / "robot.toml").write_text((source / "robot.toml").read_text())
    text = (source / "model.xml").read_text()
    (tmp_path / "model.xml").write_text(text.replace('<freejoint name="base"/>', '<freejoint name="body"/>'))
    assert check_robot(tmp_path) == []

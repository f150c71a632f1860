"""A robot folder drafted from a stranger's model can be checked and simulated as it is."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import strangers

from dynreg.draft.entry import Drafted
from dynreg.errors import RobotError
from dynreg.sim.check import problems
from dynreg.sim.effects import applicable
from dynreg.sim.engines import rollout
from dynreg.sim.lint import doubts
from dynreg.sim.run import Run


def drafted(folder: Path, text: str, **stated) -> Drafted:
    path = folder / ("robot.urdf" if "<robot" in text else "robot.xml")
    path.write_text(text)
    return strangers.draft(path, "stranger", **stated)


MODELS = {
    "position": (strangers.ARM.format(actuators=strangers.POSITION), {}),
    "motor": (strangers.ARM.format(actuators=strangers.MOTOR), {}),
    "velocity": (strangers.ARM.format(actuators=strangers.VELOCITY), {}),
    "general": (strangers.ARM.format(actuators=strangers.GENERAL), {}),
    "dcmotor": (strangers.ARM.format(actuators=strangers.CURRENT), {}),
    "no actuators": (strangers.ARM.format(actuators=""), {}),
    "stated drives": (
        strangers.ARM.format(actuators=strangers.MOTOR),
        {"drive": "position", "kp": 20.0, "kd": 1.5},
    ),
    "quadruped": (strangers.quadruped(), {}),
    "cart": (strangers.CART, {}),
    "slider": (strangers.SLIDER, {}),
    "cartpole": (strangers.CARTPOLE, {}),
    "urdf": (strangers.URDF, {}),
}


@pytest.mark.parametrize("text, stated", MODELS.values(), ids=MODELS)
def test_a_draft_passes_the_check_as_it_is(text, stated, tmp_path):
    made = drafted(tmp_path, text, **stated)
    assert problems(made.robot) == []
    assert not [said for (at, *_), said in doubts(made.robot) if at == "parameters"]
    assert len(made.robot.space) <= 18


def drive(made: Drafted, joint: str):
    tables = {d.joint: d for d in made.robot.file.drives}
    return tables.get(joint) or tables["*"]


def test_a_position_actuator_becomes_a_position_drive(tmp_path):
    made = drafted(tmp_path, MODELS["position"][0])
    assert made.robot.actions == ("shoulder/target", "elbow/target")
    one, other = drive(made, "shoulder"), drive(made, "elbow")
    assert (one.gain, one.rate_gain, one.torque_limit) == (40.0, 1.0, 8.0)
    assert (other.gain, other.rate_gain) == (20.0, 0.5) and other.torque_limit > 20.0 * np.pi


@pytest.mark.parametrize(
    ("ends", "stated", "told"),
    [("-5 2", {}, True), ("-5 2", {"torque_limit": 30.0}, False), ("-5 5", {}, False)],
)
def test_forces_that_differ_by_direction_are_told(ends, stated, told, tmp_path):
    actuators = f"""<actuator><position joint="shoulder" kp="0.4" gear="10" forcerange="{ends}"/>
      <position joint="elbow" kp="20" kv="0.5" forcerange="-3 3"/></actuator>"""
    made = drafted(tmp_path, strangers.ARM.format(actuators=actuators), **stated)
    assert drive(made, "shoulder").torque_limit == stated.get("torque_limit", 50.0)
    notes = [note for note in made.notes if "by direction" in note]
    assert len(notes) == told and all("(shoulder: -50 to 20)" in note for note in notes)


def test_a_motor_has_its_gear_and_range(tmp_path):
    made = drafted(tmp_path, MODELS["motor"][0])
    assert made.robot.actions == ("shoulder/command", "elbow/torque")
    assert [a.unit for a in made.robot.file.actions] == ["1", "N*m"]
    assert drive(made, "shoulder").gain == 5.0
    np.testing.assert_allclose(made.robot.action_ranges, [[-1, 1], [-2, 2]])


def test_a_general_actuator_is_a_servo_in_the_units_of_its_joint(tmp_path):
    made = drafted(tmp_path, MODELS["general"][0])
    one, other = drive(made, "shoulder"), drive(made, "elbow")
    assert (one.type, one.gain, one.rate_gain) == ("position", 20.0, 1.0)
    assert (other.type, other.gain, other.rate_gain) == ("position", 20.0, 2.0)
    np.testing.assert_allclose(
        made.robot.action_ranges, [[-1.0, 1.0], [-np.inf, np.inf]]
    )  # 100 of 0.2 / 20 rad each


def test_a_range_of_targets_is_the_models_own(tmp_path):
    """MuJoCo cuts targets off at an actuator's ctrlrange, and nowhere else: not at its joint's stops."""
    ranged = strangers.POSITION.replace('forcerange="-8 8"', 'forcerange="-8 8" ctrlrange="-2 2"')
    made = drafted(tmp_path, strangers.ARM.format(actuators=ranged))
    np.testing.assert_array_equal(made.robot.action_ranges, [[-2, 2], [-np.inf, np.inf]])
    np.testing.assert_array_equal(made.robot.model.actuator_ctrllimited, [1, 0])
    run = Run(np.full((1, 100, 2), 3.0))
    cut = Run(run.actions.clip([-2, -np.inf], [2, np.inf]))
    at_stop = Run(run.actions.clip(-np.pi / 2, np.pi / 2))
    asked, same, other = (
        rollout(made.robot, made.robot.space.nominal[None], r, engine="mujoco").states
        for r in (run, cut, at_stop)
    )
    np.testing.assert_array_equal(asked, same)
    assert np.abs(asked - other)[..., :2].max() > 0.01


def test_stated_gains_replace_those_of_motors_within_their_torques(tmp_path):
    made = drafted(tmp_path, *MODELS["stated drives"][:1], **MODELS["stated drives"][1])
    one = drive(made, "shoulder")
    assert (one.type, one.gain, one.rate_gain, one.torque_limit) == ("position", 20.0, 1.5, 5.0)


@pytest.mark.parametrize("kind", ["position", "motor", "velocity", "general", "dcmotor"])
def test_the_draft_moves_as_the_model_does_in_mujoco(kind, tmp_path):
    text = MODELS[kind][0]
    made = drafted(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    controls = {
        "position": (0.4, -0.3),
        "motor": (0.1, 0.2),
        "velocity": (1.0, -1.0),
        "general": (40.0, -0.3),
        "dcmotor": (3.0, 2.0),
    }[kind]
    scale = {"general": (0.01, 0.5)}.get(kind, (1.0, 1.0))
    steps = round(0.2 / model.opt.timestep)
    data.ctrl[:] = controls
    mujoco.mj_step(model, data, steps)
    robot = made.robot
    run = Run(np.tile(np.multiply(controls, scale), (1, round(0.2 * robot.rate), 1)))
    states = rollout(robot, robot.space.nominal[None], run, engine="mujoco").states
    np.testing.assert_allclose(states[0, 0, -1, :2], data.qpos, atol=2e-3)


@pytest.mark.parametrize("gear", [1.0, -2.0])
def test_what_a_filter_holds_keeps_to_its_range(gear: float, tmp_path):
    """MuJoCo cuts off at actrange what an actuator's filter holds, not what it is told."""
    text = strangers.ARM.format(
        actuators=f"""<actuator><general joint="shoulder" gear="{gear}" dyntype="filter" dynprm="0.05" gainprm="20"
        biastype="affine" biasprm="2 -20 -1" actrange="-0.2 0.3" ctrlrange="-2 2"/></actuator>"""
    )
    made = drafted(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    ends, count = [], round(0.2 * made.robot.rate)
    for limited in (1, 0):
        model.actuator_actlimited[:] = limited
        data = mujoco.MjData(model)
        data.ctrl[:] = 1.5
        mujoco.mj_step(model, data, round(0.2 / model.opt.timestep))
        ends.append(data.qpos[0])
    assert abs(ends[0] - ends[1]) > 0.05
    run = Run(np.full((1, count, 1), (1.5 * 20 + 2) / (20 * gear)))
    states = rollout(made.robot, made.robot.space.nominal[None], run, engine="mujoco").states
    np.testing.assert_allclose(states[0, 0, -1, 0], ends[0], atol=2e-3)


@pytest.mark.parametrize(
    ("first", "second", "frc", "told"),
    [
        ("", "", "", False),
        ('forcerange="-5 5"', "", "", True),
        ("", 'forcerange="-5 5"', "", True),
        ("", "", 'actuatorfrcrange="-5 5"', False),
    ],
)
def test_a_damping_servo_beside_a_limited_one_is_told(first, second, frc, told, tmp_path):
    both = f"""<actuator><position joint="shoulder" kp="40" {first}/><velocity joint="shoulder" kv="2" {second}/>
      </actuator>"""
    text = strangers.ARM.format(actuators=both).replace('name="shoulder"', f'name="shoulder" {frc}')
    made = drafted(tmp_path, text)
    assert (drive(made, "shoulder").gain, drive(made, "shoulder").rate_gain) == (40.0, 2.0)
    assert any("limits their forces one by one" in note for note in made.notes) == told


@pytest.mark.parametrize(
    ("off", "action"), [(0, "shoulder/target"), (2, "shoulder/torque"), (1, "shoulder/target")]
)
def test_actuators_that_the_model_switches_off_get_no_drive(off: int, action: str, tmp_path):
    actuators = """<actuator><motor name="m" joint="shoulder" group="0"/>
      <position name="p" joint="shoulder" group="2" kp="40" kv="2"/></actuator>"""
    if off == 1:  # nothing is left
        actuators = actuators.replace('group="0"', 'group="1"').replace('group="2"', 'group="1"')
    text = strangers.ARM.format(actuators=actuators)
    text = text.replace("<option ", f'<option actuatorgroupdisable="{off}" ')
    made = drafted(tmp_path, text)
    assert made.robot.actions[0] == action and len(made.robot.actions) == (2 if off == 1 else 1)
    names = {0: "m", 1: "m, p", 2: "p"}[off]
    assert any(f"switches actuators off ({names}, by" in note for note in made.notes)
    assert problems(made.robot) == [] and not any("switched off" in said for _, said in doubts(made.robot))
    run = Run(np.full((1, 20, len(made.robot.actions)), 0.3))
    moved = rollout(made.robot, made.robot.space.nominal[None], run, engine="mujoco").states[0, 0]
    still = rollout(made.robot, made.robot.space.nominal[None], Run(-run.actions), engine="mujoco").states[
        0, 0
    ]
    assert np.abs(moved - still).max() > 0.01, "the drive acts"


def test_a_delay_that_no_drive_has_is_told(tmp_path):
    late = strangers.POSITION.replace('kp="40"', 'name="s" kp="40" delay="0.05" nsample="30"')
    made = drafted(tmp_path, strangers.ARM.format(actuators=late))
    assert any("delays of actuators are left out (s: 0.05 s)" in note for note in made.notes)


def test_a_quadruped_stands_and_has_the_channels_of_its_base(tmp_path):
    made = drafted(tmp_path, MODELS["quadruped"][0])
    assert made.base == "base"
    assert {"base/roll", "base/pitch", "base/yaw", "base/z", "base/wx"} <= set(made.robot.channels)
    assert made.robot.file.fall is not None
    assert {"base_mass", "limb_mass", "ground_friction", "thigh_friction", "shank_gain"} <= set(
        made.robot.space.names
    )
    assert any("ground" in note for note in made.notes)
    assert "[gait] and [[tasks]]" in " ".join(made.files["robot.toml"].decode().split())
    assert not any("[gait]" in note for note in drafted(tmp_path, MODELS["cart"][0]).notes)


def test_a_payload_is_the_last_link_and_torques_have_no_gain_to_doubt(tmp_path):
    made = drafted(tmp_path, MODELS["motor"][0])
    by_name = {p.name: p for p in made.robot.space.parameters}
    assert by_name["tip_mass"].sets == ("modifier.mass[fore] =",)
    assert by_name["tip_mass"].nominal == 0.2
    assert "link_mass" in by_name and "gain" not in by_name


def mass_of(made: Drafted, name: str):
    (found,) = [p for p in made.robot.space.parameters if p.name == name]
    return found


def test_an_arm_may_carry_what_its_drives_hold_and_no_more_than_it_weighs(tmp_path):
    """A hand of 20 g on a shoulder of 1 and of 30 N*m: its own mass says nothing of a payload."""
    light = strangers.ARM.replace('mass="0.2"', 'mass="0.02"').format(actuators=strangers.MOTOR)
    most = {}
    for strength in (0.2, 6.0):
        strong = light.replace('gear="5" ctrlrange="-1 1"', f'gear="5" ctrlrange="-{strength} {strength}"')
        strong = strong.replace('ctrlrange="-2 2"', f'ctrlrange="-{2 * strength} {2 * strength}"')
        folder = tmp_path / str(strength)
        folder.mkdir()
        tip = mass_of(drafted(folder, strong), "tip_mass")
        assert tip.nominal == pytest.approx(0.02)
        most[strength] = tip.high
    # stretched out level, the shoulder's 1 N*m hold 0.2 kg at 0.3 m beside the upper arm; its 30 N*m hold 9.9 kg,
    # and the arm weighs 0.42 kg
    assert 0.2 < most[0.2] < 0.42 and most[6.0] == pytest.approx(0.44, rel=0.05)


def test_a_payload_that_no_drive_holds_up_has_the_usual_range(tmp_path):
    """On a level slide nothing weighs, and a drive of 10 N would hold any mass."""
    cart = mass_of(drafted(tmp_path, strangers.CARTPOLE), "moving_mass")
    assert (cart.low, cart.high) == (0.5, 4.0)


def test_meshes_that_are_missing_are_said_and_left_out(tmp_path):
    made = drafted(tmp_path, strangers.URDF)
    assert any("2 meshes were not found" in note for note in made.notes)
    assert [d.torque_limit for d in made.robot.file.drives] == [20.0, 10.0]
    assert list(made.files) == ["robot.toml", "model.xml"]


def test_files_from_other_folders_come_along(tmp_path):
    made = strangers.draft(strangers.in_folders(tmp_path), "scene", root=tmp_path)
    assert set(made.files) == {"robot.toml", "model.xml", "assets/tip.obj"}
    assert problems(made.robot) == []


def test_the_same_model_gives_the_same_bytes(tmp_path):
    assert drafted(tmp_path, strangers.SLIDER).files == drafted(tmp_path, strangers.SLIDER).files


BAD = {
    "no model": ("<html/>", "is no robot model"),
    "no joints": ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "no joint that can be driven"),
    "broken": ("<mujoco><worldbody><body></worldbody></mujoco>", "MuJoCo does not read"),
    "a missing mesh": (
        "<mujoco><asset><mesh name='a' file='a.stl'/></asset><worldbody><body><joint/><geom type='mesh' mesh='a'/>"
        "</body></worldbody></mujoco>",
        "a.stl",
    ),
}


@pytest.mark.parametrize("text, said", BAD.values(), ids=BAD)
def test_what_is_no_robot_is_refused_in_one_line(text, said, tmp_path):
    with pytest.raises(RobotError) as refused:
        drafted(tmp_path, text)
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_what_is_not_understood_is_said(tmp_path):
    text = strangers.ARM.format(
        actuators='<tendon><fixed name="both"><joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed>'
        '</tendon><actuator><position joint="elbow" kp="20" kv="0.5"/><motor name="pull" tendon="both"/></actuator>'
    )
    made = drafted(tmp_path, text)
    assert made.robot.actions == ("elbow/target",)
    assert any("pull" in note for note in made.notes) and any("tendon" in note for note in made.notes)
    assert "pull" in made.files["robot.toml"].decode()
    assert problems(made.robot) == []


CUBE = """<body name="cube" pos="0.6 0 0.05"><freejoint name="cube"/>
  <geom type="box" size="0.05 0.05 0.05" mass="0.1"/></body>"""


@pytest.mark.parametrize(
    ("model", "base"), [(strangers.CART, "base"), (strangers.ARM.format(actuators=strangers.POSITION), None)]
)
def test_an_object_that_lies_loose_is_said_to_be_no_base(model, base, tmp_path):
    floor = "<geom type='plane' size='5 5 0.1'/>"
    made = drafted(tmp_path, model.replace("<worldbody>", f"<worldbody>{floor}{CUBE}", 1))
    assert made.base == base and not any(name.startswith("cube/") for name in made.robot.channels)
    assert any("not the robot's base" in note and note.endswith(": cube") for note in made.notes)
    assert not any("not the robot's base" in note for note in drafted(tmp_path, model).notes)


@pytest.mark.parametrize(("second", "begins"), [("", 0.5), ("name='bent' ", -0.4)])
def test_episodes_begin_from_a_keyframe_without_a_name_where_none_has_one(second, begins, tmp_path):
    keys = f'<keyframe><key qpos="0.5 -0.3"/><key {second}qpos="-0.4 0.1"/></keyframe></mujoco>'
    made = drafted(tmp_path, MODELS["position"][0].replace("</mujoco>", keys))
    robot = made.robot
    assert robot.model.key_qpos[robot.keyframe, 0] == begins
    assert any("no keyframe of the model has a name" in note for note in made.notes) is (not second)
    assert problems(robot) == []


CARRY = {  # names of sites: those of them that are for a tool
    "tip": "tip",
    "arm-tip": "arm-tip",
    "left_hand hand2": "left_hand hand2",
    "end_effector EE_frame eef": "end_effector EE_frame eef",
    "tcp gripper1 tool0": "tcp gripper1 tool0",
    "FL_tip FR_tip RL_tip RR_tip": "",
    "FL_foot FL_foot_tip": "",
    "index_finger_tip hand_camera handle tipper": "",
}


def test_sites_that_are_named_for_a_tool_are_where_the_robot_may_carry(tmp_path):
    text = MODELS["position"][0].replace(
        '<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.015"',
        '<site name="attachment_site" pos="0.2 0 0"/><site name="wheel"/><site name="knee2"/>'
        '<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.015"',
    )
    assert drafted(tmp_path, text).robot.tools == ("attachment_site",)
    for name, told in CARRY.items():
        sites = "".join(f'<site name="{one}"/>' for one in name.split())
        assert drafted(tmp_path, text.replace('<site name="wheel"/>', sites)).robot.tools == (
            "attachment_site",
            *told.split(),
        )
    frames = (
        '<link name="tool0"/><joint name="at_end" type="fixed"><origin xyz="0.2 0 0.1"/><parent link="{0}"/>'
        '<child link="tool0"/></joint><link name="camera"/><joint name="seen" type="fixed"><parent link="{0}"/>'
        '<child link="camera"/></joint></robot>'
    )
    arm = drafted(tmp_path, strangers.URDF.replace("</robot>", frames.format("lower_link"))).robot
    assert arm.tools == ("tool0",) and arm.model.site("tool0").bodyid[0] == arm.model.body("tool0").id
    assert ("tool0",) in applicable(arm)["payload"].places(arm)
    assert drafted(tmp_path, strangers.URDF).robot.tools == ()
    assert drafted(tmp_path, MODELS["position"][0]).robot.tools == ()

"""The time step, the engines and the parameters of a draft: chosen so that its own check has nothing to say."""

from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import strangers

from dynreg.data.ingest import read_log
from dynreg.data.series import Series
from dynreg.draft.drives import Drive
from dynreg.draft.entry import Drafted, Entry, Notes
from dynreg.draft.heard import sensed
from dynreg.draft.tables import Tables
from dynreg.draft.trial import stiffest, with_sound_ranges
from dynreg.sim.check import problems
from dynreg.sim.extremes import Tried

SERVO = """<mujoco><worldbody><body name="arm"><joint name="servo" axis="0 1 0" armature="0.004"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.01" mass="0.1"/></body></worldbody>
  <actuator><position joint="servo" kp="8" kv="0.3" forcerange="-2 2"/></actuator></mujoco>"""
WRIST = """<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.015" mass="0.2"/>
  <body name="hand" pos="0.2 0 0"><joint name="wrist" axis="1 0 0" range="-90 90"/>
  <geom type="sphere" size="0.004" mass="0.003"/></body>"""
TOOL = '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>'
THIRD = '<position joint="wrist" kp="20" kv="{kv}"/></actuator>'


def drafted(folder: Path, text: str, **stated) -> Drafted:
    path = folder / "robot.xml"
    path.write_text(text)
    return strangers.draft(path, "stranger", **stated)


def wristed(kv: float, integrator: str = "Euler") -> str:
    """An arm with a hand of 3 grams, whose drive has a gain of 20 and this rate gain."""
    text = strangers.ARM.replace(WRIST.split("\n")[0], WRIST).replace("implicitfast", integrator)
    return text.format(actuators=strangers.POSITION.replace("</actuator>", THIRD.format(kv=kv)))


def test_a_servo_runs_on_the_fast_engine(tmp_path):
    made = drafted(tmp_path, SERVO)
    assert made.robot.file.robot.engines == ["joint", "mujoco"] and problems(made.robot) == []
    assert any("engine joint" in note for note in made.notes)


def test_so_does_a_servo_with_stops_where_its_time_step_is_fine(tmp_path):
    """The engines' integrators differ by half a time step: too much of a coarse one, and a note says so."""
    stopped = SERVO.replace('armature="0.004"', 'armature="0.004" range="-60 60"')
    made = drafted(tmp_path, stopped.replace("<mujoco>", '<mujoco><option timestep="0.001"/>'))
    assert made.robot.file.robot.engines == ["joint", "mujoco"] and problems(made.robot) == []
    lively = stopped.replace('kv="0.3"', 'kv="0.05"')
    made = drafted(tmp_path, lively.replace("<mujoco>", '<mujoco><option timestep="0.005"/>'))
    assert made.robot.file.robot.engines == ["mujoco"]
    (note,) = [note for note in made.notes if "engine joint" in note]
    assert "left out: servo/" in note and note.endswith("with a time step of 0.00125 s they agree")


def test_joints_that_pull_at_each_other_do_not(tmp_path):
    """Also where stiff drives hide it from what they are told to do."""
    stiff = strangers.POSITION.replace('kp="40" kv="1"', 'kp="4000" kv="300"').replace(
        'forcerange="-8 8"', ""
    )
    for actuators in (strangers.POSITION, stiff):
        made = drafted(tmp_path, strangers.ARM.format(actuators=actuators))
        assert made.robot.file.robot.engines == ["mujoco"]


@pytest.mark.parametrize("kv", [1.5, 0.0])
def test_a_stiff_wrist_gets_an_integrator_or_a_rotor_and_a_line_that_says_so(kv, tmp_path):
    made = drafted(tmp_path, wristed(kv))
    assert problems(made.robot) == []
    head, said = made.robot.file.robot, " ".join(made.notes)
    assert head.timestep >= 0.002 / 8
    if kv:
        assert head.integrator == "implicitfast" and head.timestep == 0.002
        assert "the drive of wrist damps it within" in said
    else:
        assert made.robot.model.joint("wrist").armature[0] > 1e-6 and "joint wrist got armature" in said
        assert any(p.name == "wrist_armature" and p.nominal > 1e-6 for p in made.robot.space.parameters)


def test_a_draft_says_what_its_parameters_set(tmp_path):
    by_name = {p.name: p for p in drafted(tmp_path, SERVO).robot.space.parameters}
    assert "tip_mass" not in by_name and by_name["moving_mass"].sets == ("modifier.mass[arm] =",)
    gripper = '<body name="finger" pos="0.1 0 0"><joint name="{0}" type="slide"/><geom size="0.01" mass="0.05"/></body>'
    two = gripper.format("left_finger") + gripper.format("right_finger").replace('"finger"', '"thumb"')
    text = strangers.ARM.format(actuators="").replace(WRIST.split("\n")[0], WRIST.split("\n")[0] + two)
    by_name = {p.name: p for p in drafted(tmp_path, text).robot.space.parameters}
    assert by_name["hand_mass"].sets == ("modifier.mass[fore,finger,thumb] *=",)


def test_a_finger_that_follows_the_driven_one_is_of_the_hand(tmp_path):
    """A gripper of one drive, whose other finger an equality ties to it: what the arm may carry is not one finger's."""
    finger = '<body name="{0}" pos="0.1 0 0"><joint name="{0}" type="slide"/><geom size="0.01" mass="0.05"/></body>'
    two, geom = finger.format("finger") + finger.format("thumb"), WRIST.split("\n")[0]
    drive = '<position joint="finger" kp="40" kv="1"/></actuator>'
    ties = '<equality><joint joint1="thumb" joint2="finger"/></equality></mujoco>'
    text = strangers.ARM.format(actuators=strangers.POSITION).replace(geom, geom + two)
    text = text.replace("</actuator>", drive).replace("</mujoco>", ties)
    by_name = {p.name: p for p in drafted(tmp_path, text).robot.space.parameters}
    assert by_name["hand_mass"].sets == ("modifier.mass[fore,finger,thumb] *=",) and "tip_mass" not in by_name


def test_a_frame_at_the_end_of_an_arm_carries_no_payload(tmp_path):
    """A last body of next to no mass, as some models have: a range to what the drives hold would begin at nothing."""
    text = wristed(1.0).replace('<geom type="sphere" size="0.004" mass="0.003"/>', TOOL)
    ranges = {p.name: (p.low, p.high) for p in drafted(tmp_path, text).robot.space.parameters}
    low, high = ranges.get("tip_mass", (1.0, 4.0))
    assert high / low <= 8.0 and "link_mass" in ranges


def test_gains_and_torque_limits_of_servos_are_doubted(tmp_path):
    made = drafted(tmp_path, SERVO)
    by_name = {p.name: p for p in made.robot.space.parameters}
    assert [by_name[n].nominal for n in ("gain", "rate_gain", "torque_limit")] == [8.0, 0.3, 2.0]
    assert by_name["gain"].tolerance < by_name["rate_gain"].tolerance < 0.5
    text = made.files["robot.toml"].decode()
    assert text.count("# Ranges:") == 1 and text.count("tells only ratios") == 1


def test_a_torque_limit_can_be_stated_and_a_guessed_gain_is_doubted_most(tmp_path):
    bare = SERVO[: SERVO.index("<actuator>")] + "</mujoco>"
    made = drafted(tmp_path, bare, torque_limit=1.5)
    assert made.robot.file.drives[0].torque_limit == 1.5
    assert next(p for p in made.robot.space.parameters if p.name == "gain").tolerance >= 0.5
    assert not any("--torque-limit" in note for note in made.notes)
    assert any("the torque limit of servo is not known" in note for note in drafted(tmp_path, bare).notes)


def test_ranges_of_what_the_model_leaves_out_follow_the_torques_of_the_log(tmp_path):
    """A wrist's link weighs nothing; its drive's friction is that of its gear."""
    text = (
        wristed(1.0)
        .replace('damping="0.1"', "")
        .replace('size="0.004" mass="0.003"', 'size="0.03" mass="0.1"')
    )
    text = text[: text.index("<actuator>")] + "</mujoco>"
    log, time = tmp_path / "run.csv", np.arange(0, 3, 0.01)
    joints = ("shoulder", "elbow", "wrist")
    head = ["t_s", *(f"pos_{j}" for j in joints), *(f"trq_{j}" for j in joints)]
    sine = np.sin(2 * time)
    columns = np.stack([time, *(0.3 * sine for _ in joints), *(most * sine for most in (40.0, 20.0, 5.0))])
    log.write_text("\n".join([",".join(head), *(",".join(f"{v:.6g}" for v in row) for row in columns.T)]))
    made = drafted(tmp_path, text, log=read_log(log), drive="torque")
    by_name = {p.name: p for p in made.robot.space.parameters}
    assert by_name["wrist_friction"].high == pytest.approx(0.15 * 5.0 / 0.6, rel=0.05)
    without = {p.name: p for p in drafted(tmp_path, text, drive="torque").robot.space.parameters}
    assert without["wrist_friction"].high > 0.01 * without["shoulder_friction"].high


def test_measured_torques_beside_commands_are_said_to_tell_gains_and_to_be_no_evidence(tmp_path):
    log, time = tmp_path / "run.csv", np.arange(0, 3, 0.01)
    columns = np.stack([time, 0.3 * np.sin(2 * time), 0.31 * np.sin(2 * time), 0.4 * np.cos(2 * time)])
    rows = [",".join(f"{v:.6g}" for v in row) for row in columns.T]
    log.write_text("\n".join(["t_s,pos_servo,cmd_servo,effort_servo", *rows]))
    made = drafted(tmp_path, SERVO, log=read_log(log))
    assert any("measures the torque of 1 joint" in note and "not as evidence" in note for note in made.notes)
    assert "# the log measures the torque" in made.files["robot.toml"].decode()


@pytest.mark.parametrize("rate", [50, 200])
@pytest.mark.parametrize("noise", [0.0003, 0.003])
def test_noise_of_a_joint_that_never_stands_still(rate, noise):
    rng, time = np.random.default_rng(1), np.arange(1500) / rate
    values = 0.5 * np.sin(2 * np.pi * 1.5 * time) + noise * rng.standard_normal(len(time))
    assert sensed(Series(time, values), "rad").noise == pytest.approx(noise, rel=0.35)


def test_a_ground_that_is_put_in_touches_feet_as_the_plane_of_any_scene_does(tmp_path):
    """MuJoCo takes the larger friction of both; scenes that makers of robots ship have a plane of 1."""
    foot = 'size="0.015" mass="0.01"'
    text = strangers.quadruped().replace(foot, f'{foot} friction="0.4 0.01 0.001"')
    made = drafted(tmp_path, text)
    by_name = {p.name: p for p in made.robot.space.parameters}
    assert by_name["ground_friction"].nominal == pytest.approx(1.0)
    data = mujoco.MjData(made.robot.model)
    data.qpos[2] = 0.24
    mujoco.mj_forward(made.robot.model, data)
    assert data.ncon and data.contact.friction[:, 0] == pytest.approx(1.0)


def test_a_comment_says_that_a_torque_limit_is_no_guess_of_gains(tmp_path):
    bare = SERVO[: SERVO.index("<actuator>")] + "</mujoco>"
    text = drafted(tmp_path, bare, torque_limit=0.2).files["robot.toml"].decode()
    head = text[: text.index('name = "torque_limit"')].rstrip().split("\n")[-1]
    assert "guessed" not in head and "stated" in head


def test_a_drive_is_judged_in_the_pose_that_episodes_begin_from(tmp_path):
    """The keyframe called home, not the first one, in which the arm is stretched out."""
    keys = """<keyframe><key name="zero" qpos="0 0"/><key name="home" qpos="0 1.5"/></keyframe></mujoco>"""
    text = strangers.ARM.format(actuators=strangers.POSITION).replace("</mujoco>", keys)
    model, drive = mujoco.MjModel.from_xml_string(text), Drive("shoulder", "position", 40.0)
    (found,) = stiffest(model, (drive,))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 1)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, matrix)
    assert found.inertia == pytest.approx(1.0 / np.linalg.inv(matrix)[0, 0])


@pytest.mark.parametrize("sound_from", [3, 100])
def test_ranges_that_were_narrowed_are_said(sound_from, tmp_path, monkeypatch):
    tries = iter(range(100))

    def tried(robot, engine, *, whole):
        wild = (("parameters", "gain", "high"), "diverges")
        return Tried((wild,) if next(tries) < sound_from else ())

    monkeypatch.setattr("dynreg.draft.trial.try_out", tried)
    entry = Entry({"name": "gain", "nominal": 1.0, "low": 0.5, "high": 5.0, "scale": "linear"})
    none = Entry({})
    tables = Tables(none, (), (), (), (entry,))
    robot = SimpleNamespace(running=lambda: "mujoco")
    made = with_sound_ranges(lambda _: robot, tables, notes := Notes())
    high = 1.0 + 4.0 * 0.25 ** min(sound_from, 6)
    assert made.parameters[0].values["high"] == pytest.approx(high)
    assert any(f"gain narrowed to 0.5 to {high:.4g}: simulations diverge" in n for n in notes.lines)
    assert any("robots check tells what is left" in n for n in notes.lines) is (sound_from > 6)

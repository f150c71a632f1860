"""What a log adds to a draft: rate, noise, the kind of drives, a map with which it is read."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import strangers

from dynreg.data.ingest import read_log, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.series import RawLog, Series
from dynreg.draft.heard import Heard, sensed
from dynreg.draft.tables import channel_tables
from dynreg.sim.engines import rollout
from dynreg.sim.run import Run

RATE, NOISE = 125.0, 0.002


def logged(folder: Path, text: str, names: dict[str, str], control) -> Path:
    """A log of the model as MuJoCo moves it: {column: "q", "v" or "u" and the number of the joint}."""
    model = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    rows = []
    for step in range(round(3 * RATE)):
        data.ctrl[:] = control(step / RATE)
        taken = {"q": data.qpos + NOISE * rng.standard_normal(model.nq), "v": data.qvel, "u": data.ctrl}
        rows.append(
            {name: taken[what[0]][int(what[1:])] for name, what in names.items()} | {"t_s": step / RATE}
        )
        mujoco.mj_step(model, data, round(1 / RATE / model.opt.timestep))
    path = folder / "run.csv"
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    """An arm of position servos and its log."""
    folder = tmp_path_factory.mktemp("servo")
    text = strangers.ARM.format(actuators=strangers.POSITION)
    (folder / "arm.xml").write_text(text)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "cmd_shoulder": "u0", "cmd_elbow": "u1"}
    log = logged(folder, text, names, lambda t: (0.4 * np.sin(2 * t), 0.3 * np.sin(3 * t)))
    return strangers.draft(folder / "arm.xml", "arm", log=read_log(log)), log


def test_rate_and_noise_are_those_of_the_log(servo):
    made, _ = servo
    assert made.robot.rate == RATE
    noise = {c.name: c.noise for c in made.robot.file.channels}
    assert noise["shoulder/position"] == pytest.approx(NOISE, rel=0.3)


def test_the_log_is_read_with_the_drafted_map(servo):
    made, log = servo
    assert made.missing == ()
    recording = read_recording([log], made.robot.recording_spec, parse_map(made.files[made.map].decode()))
    assert set(made.robot.channels) <= set(recording.names)


def test_targets_beyond_the_stops_are_replayed_as_they_were_logged(tmp_path):
    """At its true parameters the draft leaves nothing unexplained but the sensors' noise."""
    text = strangers.ARM.format(actuators=strangers.POSITION)
    (tmp_path / "arm.xml").write_text(text)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "cmd_shoulder": "u0", "cmd_elbow": "u1"}
    log = logged(tmp_path, text, names, lambda t: (3.0 * np.sin(4 * t), 0.3 + 2.2 * np.sin(5 * t)))
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    robot = made.robot
    assert [(a.low, a.high) for a in robot.file.actions] == [(None, None)] * 2
    assert not robot.model.actuator_ctrllimited.any()
    recording = read_recording([log], robot.recording_spec, parse_map(made.files[made.map].decode()))
    (episode,) = recording.episodes
    told, went = (
        episode.values[:, [recording.names.index(f"{j}/{what}") for j in ("shoulder", "elbow")]]
        for what in ("target", "position")
    )
    assert np.abs(told).max() > 1.0 + np.abs(went).max() > 1.0 + np.pi / 2
    start = np.zeros((1, len(robot.channels)))  # where the log's simulation began
    run = Run(told[None, :-1], initial=start)
    states = rollout(robot, robot.space.nominal[None], run, engine="mujoco").states[0, 0]
    residual = went - states[:, [robot.channels.index(f"{j}/position") for j in ("shoulder", "elbow")]]
    assert np.sqrt((residual**2).mean(axis=0)) == pytest.approx(NOISE, rel=0.15)


def test_motors_told_positions_become_position_drives(tmp_path):
    text = strangers.ARM.format(actuators=strangers.POSITION)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "cmd_shoulder": "u0", "cmd_elbow": "u1"}
    log = logged(tmp_path, text, names, lambda t: (0.4 * np.sin(2 * t), 0.3 * np.sin(3 * t)))
    (tmp_path / "arm.xml").write_text(strangers.ARM.format(actuators=strangers.MOTOR))
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    assert made.robot.actions == ("shoulder/target", "elbow/target")
    assert any("holds commands of position drives" in note for note in made.notes)
    stated = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log), kp=12.0)
    assert [d.gain for d in stated.robot.file.drives] == [12.0, 12.0]


def test_the_control_of_a_general_actuator_is_scaled_in_the_map(tmp_path):
    text = strangers.ARM.format(actuators=strangers.GENERAL)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "cmd_shoulder": "u0", "cmd_elbow": "u1"}
    log = logged(tmp_path, text, names, lambda t: (40 * np.sin(2 * t), 0.3 * np.sin(3 * t)))
    (tmp_path / "arm.xml").write_text(text)
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    read = read_recording([log], made.robot.recording_spec, parse_map(made.files[made.map].decode()))
    told = read.episodes[0].values[:, read.names.index("shoulder/target")]
    assert np.abs(told).max() == pytest.approx(0.4, rel=0.01)


def test_a_joint_without_stops_is_in_rad_however_far_it_turns(tmp_path):
    """The range of its actuator's targets does not say how far it turns."""
    text = strangers.ARM.replace(' range="-90 90"', "", 1).format(
        actuators=strangers.POSITION.replace('joint="shoulder"', 'joint="shoulder" ctrlrange="-3 3"')
    )
    (tmp_path / "arm.xml").write_text(text)
    time = np.arange(600) / 100.0
    sources = {name: Series(time, 40.0 * np.sin(time)) for name in ("pos_shoulder", "cmd_shoulder")}
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=RawLog(tmp_path / "run.csv", sources))
    told = parse_map(made.files[made.map].decode())
    assert {told.channels[f"shoulder/{what}"].unit for what in ("position", "target")} == {"rad"}


@pytest.mark.parametrize("robots", [1, 2])
def test_a_second_robot_in_the_log_is_told(tmp_path, robots: int):
    """Their joints have the same names: whose the draft is of is the user's to say."""
    (tmp_path / "arm.xml").write_text(strangers.ARM.format(actuators=strangers.POSITION))
    time, sources, topics = np.arange(600) / 100.0, {}, []
    for topic in (f"/robot{n}/{what}" for n in range(1, robots + 1) for what in ("joint_states", "commands")):
        topics.append(topic)
        for joint in ("shoulder", "elbow"):
            sources[f"{topic}.position[{joint}]"] = Series(time, 0.3 * np.sin(2 * time))
    log = RawLog(tmp_path / "run.mcap", sources, {"topics": topics})
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=log)
    told = [note for note in made.notes if "several signals" in note]
    assert len(told) == robots - 1
    assert all("/robot1/joint_states.position[shoulder] is taken for shoulder/position" in t for t in told)


@pytest.mark.parametrize(("unit", "factor"), [("rad", 1.0), ("deg", 180 / np.pi)])
def test_targets_of_a_joint_are_not_scaled_by_its_gear(tmp_path, unit: str, factor: float):
    """The other joint, whose actuator the log commands, keeps its scale."""
    text = strangers.ARM.format(actuators=strangers.GEARED)
    (tmp_path / "arm.xml").write_text(text)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "cmd_shoulder": "u0", "cmd_elbow": "u1"}
    log = logged(tmp_path, text, names, lambda t: (4.0 * np.sin(2 * t), 3.0 * np.sin(3 * t)))
    rows = pd.read_csv(log)
    rows["cmd_shoulder"] *= 0.1
    rows[["pos_shoulder", "cmd_shoulder", "pos_elbow"]] *= factor  # a table has its angles in one unit
    rows.to_csv(log, index=False)
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    told = parse_map(made.files[made.map].decode())
    target = told.channels["shoulder/target"]
    assert (target.scale, target.unit) == (1.0, unit) and told.channels["elbow/target"].scale == 0.1
    assert any("follow the log's commands as they are" in n and "(shoulder: 0.1)" in n for n in made.notes)


@pytest.mark.parametrize("rate", [0.1, 0.4, 0.5, 1.0, 50.0, 500.0])
def test_the_rate_of_a_log_is_heard_however_slow_it_is(rate):
    assert Heard({"x/position": Series(np.arange(20) / rate, np.arange(20.0))}).rate([]) == pytest.approx(
        rate
    )


def test_commands_that_change_seldom_do_not_slow_the_robot(tmp_path):
    """Targets on a topic of their own at 2 Hz, states at 100 Hz."""
    (tmp_path / "arm.xml").write_text(strangers.ARM.format(actuators=strangers.POSITION))
    fast, slow = np.arange(600) / 100.0, np.arange(12) / 2.0
    sources = {f"pos_{joint}": Series(fast, 0.3 * np.sin(2 * fast - 0.1)) for joint in ("shoulder", "elbow")}
    sources |= {f"cmd_{joint}": Series(slow, 0.3 * np.sin(2 * slow)) for joint in ("shoulder", "elbow")}
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=RawLog(tmp_path / "run.mcap", sources))
    assert made.robot.rate == 100.0


def test_signals_of_several_clocks_in_one_table_are_heard_as_on_their_own(tmp_path):
    """Positions at 100 Hz and targets at 50 Hz, joined into rows with empty cells: each tells its own rate."""
    (tmp_path / "arm.xml").write_text(strangers.ARM.format(actuators=strangers.MOTOR))
    fast, slow = np.arange(600) / 100.0, np.arange(300) / 50.0 + 0.003
    time = np.sort(np.concatenate([fast, slow]))
    sources = {}
    for joint in ("shoulder", "elbow"):
        went, told = 0.3 * np.sin(2 * time - 0.1), 0.3 * np.sin(2 * time)
        sources[f"pos_{joint}"] = Series(time, np.where(np.isin(time, fast), went, np.nan))
        sources[f"cmd_{joint}"] = Series(time, np.where(np.isin(time, slow), told, np.nan))
    log = RawLog(tmp_path / "run.csv", sources, {"time_column": "time", "time_unit": "s"})
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=log)
    assert made.robot.actions == ("shoulder/target", "elbow/target")
    assert made.robot.rate == 50.0


@pytest.mark.parametrize("clock", ["cmd_time", "other"])
def test_commands_on_a_clock_of_their_own_are_heard_or_said_to_be_left_out(tmp_path, clock):
    (tmp_path / "arm.xml").write_text(strangers.ARM.format(actuators=strangers.POSITION))
    fast, slow = np.arange(600) / 100.0, np.arange(150) / 25.0
    position, told = (
        np.stack([0.3 * np.sin(2 * (t - late))] * 2, axis=1) for t, late in ((fast, 0.1), (slow, 0))
    )
    np.savez(tmp_path / "run.npz", time=fast, joint_pos=position, cmd_joint_pos=told, **{clock: slow})
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(tmp_path / "run.npz"))
    drafted = parse_map(made.files[made.map].decode())
    missed = [" ".join(note.split()) for note in made.notes if "no column of commands" in note]
    if clock == "cmd_time":
        assert drafted.channels["elbow/target"].source == "cmd_joint_pos[1]" and missed == []
    else:
        assert "cmd_joint_pos, other could not be read as signals: `dynreg doctor LOG` says why" in missed[0]


@pytest.mark.parametrize("noise, quantum", [(0.003, 0.0), (0.0, 0.005), (0.0, 0.0)])
def test_noise_and_quantum_are_found_in_still_moments(noise, quantum):
    rng, time = np.random.default_rng(1), np.arange(2000) / 200
    values = np.where(time < 5, np.sin(3 * time), np.sin(15)) + noise * rng.standard_normal(2000)
    values = np.round(values / quantum) * quantum if quantum else values
    found = sensed(Series(time, values), "rad")
    assert found.noise == pytest.approx(noise, rel=0.3, abs=2e-5)
    assert found.quantum == pytest.approx(quantum, rel=1e-3)


def test_the_noise_of_a_rate_that_was_computed_is_its_error_however_smooth_it_is():
    time = np.arange(2000) / 200.0
    found = sensed(replace(Series(time, np.sin(time)), error=0.0123), "rad/s")
    assert (found.noise, found.quantum, found.still) == (0.012, 0.0, False)
    assert sensed(Series(time, np.sin(time)), "rad/s").noise < 0.001


@pytest.mark.parametrize(("moves", "still"), [(0.0, True), (0.001, True), (0.1, False)])
def test_a_channel_that_does_not_leave_its_noise_has_no_weight(moves: float, still: bool):
    """The roll of a base on flat ground: its errors, in units of its motion, would drown those of what moves."""
    time = np.arange(4000) / 100.0
    noise = 0.001 * np.random.default_rng(0).standard_normal(len(time))
    found = sensed(Series(time, moves * np.sin(time) + noise), "rad")
    assert found.still is still
    (table,) = channel_tables([("base/roll", "rad", 1.0)], {"base/roll": found})
    assert table.values.get("weight", 1.0) == (0.0 if still else 1.0)


def test_the_rate_of_a_table_is_known_where_none_of_its_columns_is(tmp_path):
    text = strangers.ARM.format(actuators=strangers.POSITION)
    (tmp_path / "arm.xml").write_text(text)
    names = {"first": "q0", "second": "q1", "third": "u0", "fourth": "u1"}
    log = logged(tmp_path, text, names, lambda t: (0.4 * np.sin(2 * t), 0.3 * np.sin(3 * t)))
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    assert "shoulder/target" in made.missing
    assert made.robot.rate == RATE and b"control_rate: of the log's stamps" in made.files["robot.toml"]
    table = pd.read_csv(log)
    table.rename(columns={"t_s": "time"}).assign(time=1e3 * table["t_s"]).to_csv(log, index=False)
    told = strangers.draft(
        tmp_path / "arm.xml", "arm", log=read_log(log)
    )  # in ms, which its name does not say
    assert told.robot.rate == 50.0 and b"control_rate: a guess" in told.files["robot.toml"]


def test_a_column_may_be_called_as_the_actuator_is_and_a_command_that_is_missing_is_told(tmp_path):
    text = strangers.ARM.format(
        actuators=strangers.POSITION.replace("<position ", '<position name="lift" ', 1)
    )
    (tmp_path / "arm.xml").write_text(text)
    names = {"pos_shoulder": "q0", "pos_elbow": "q1", "lift.cmd": "u0", "other": "u1"}
    log = logged(tmp_path, text, names, lambda t: (0.4 * np.sin(2 * t), 0.3 * np.sin(3 * t)))
    made = strangers.draft(tmp_path / "arm.xml", "arm", log=read_log(log))
    assert made.missing == ("elbow/target",)
    assert 'source = "lift.cmd"' in made.files[made.map].decode()
    (said,) = [line for line in made.notes if "no column of commands was recognised" in line]
    assert "(for elbow/target). It holds other, " in said

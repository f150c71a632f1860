"""A map drafted from a log is taken by `read_recording` as it is, and gives the numbers that were logged."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from ros_log import JOINTS, truth, write_robot
from scipy.spatial.transform import Rotation

from dynreg.data.drafting import draft_map
from dynreg.data.drafting.offers import offers_of
from dynreg.data.ingest import read_recording
from dynreg.data.maps import check_map, parse_map
from dynreg.data.readers import read_log
from dynreg.data.readers.columns import from_columns
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog

BASE = [("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"), ("x", "m"), ("y", "m"), ("z", "m")]
BASE += [("vx", "m/s"), ("vy", "m/s"), ("vz", "m/s"), ("wx", "rad/s"), ("wy", "rad/s"), ("wz", "rad/s")]


def spec_of(*channels: tuple, rate: float | None = 100.0, settings=()) -> RecordingSpec:
    return RecordingSpec("robot", tuple(ChannelSpec(*c) for c in channels), settings, rate)


def table(tmp_path: Path, **columns: np.ndarray) -> RawLog:
    rows = len(next(iter(columns.values())))
    every = {"time": 0.01 * np.arange(rows)} | {k: np.asarray(v, float) for k, v in columns.items()}
    from dynreg.data.readers import ReadOptions

    return from_columns(tmp_path / "log.csv", every, ReadOptions())


def test_a_ros_log_of_a_robot_with_a_base(tmp_path: Path):
    """Joints that are named a little differently, a trajectory as the command, attitude from quaternions."""
    write_robot(tmp_path / "run.mcap")
    joints = ("left_shoulder", "left_elbow")
    channels = [(f"{j}/position", "rad", "state") for j in joints]
    channels += [(f"{j}/velocity", "rad/s", "state") for j in joints]
    channels += [(f"torso/{what}", unit, "state") for what, unit in BASE]
    channels += [(f"{j}/target", "rad", "action") for j in joints]
    spec = spec_of(*channels)
    draft = draft_map(read_log(tmp_path / "run.mcap"), spec)
    assert draft.missing == ()
    recording = read_recording(tmp_path / "run.mcap", spec, parse_map(draft.text))
    (episode,) = recording.episodes
    told, rows = truth(), len(episode.time)
    wanted = np.concatenate(
        [told[n] for n in ("position", "velocity", "rpy", "place", "linear", "rate", "command")], axis=1
    )
    np.testing.assert_allclose(episode.values, wanted[:rows], atol=1e-6)
    assert rows == len(told["time"])


def test_without_a_robot_channels_are_proposed(tmp_path: Path):
    write_robot(tmp_path / "run.mcap")
    draft = draft_map(read_log(tmp_path / "run.mcap"))
    drafted = parse_map(draft.text)
    proposed = {f"{j}/{what}" for j in JOINTS for what in ("position", "velocity", "target")}
    assert set(drafted.channels) == proposed | {f"base/{what}" for what, _ in BASE}
    assert drafted.channels["base/yaw"].source == "/odom.pose.pose.orientation"


COLUMNS = {
    "pos_FL_hip": ("FL_hip_joint/position", "state"),
    "q_FL_hip": ("FL_hip/position", "state"),
    "FL_hip_pos": ("fl_hip/position", "state"),
    "FL_hip.position": ("fl_hip/position", "state"),
    "fl_hip/position": ("fl_hip/position", "state"),
    "vel_FL_hip": ("FL_hip/velocity", "state"),
    "dq_FL_hip": ("FL_hip/velocity", "state"),
    "q_dot_FL_hip": ("FL_hip/velocity", "state"),
    "FL_hip_theta_dot": ("FL_hip/velocity", "state"),
    "FL_hip_qdot": ("FL_hip/velocity", "state"),
    "rate_FL_hip": ("FL_hip/velocity", "state"),
    "cmd_FL_hip": ("FL_hip/target", "action"),
    "action[FL_hip.pos]": ("FL_hip/target", "action"),
    "tau_cmd_FL_hip": ("FL_hip/torque", "action"),
    "observation.state[FL_hip.pos]": ("FL_hip/position", "state"),
}
UNITS = {"position": "rad", "velocity": "rad/s", "target": "rad", "torque": "N*m"}


@pytest.mark.parametrize("column", COLUMNS)
def test_columns_that_name_a_joint(column: str, tmp_path: Path):
    """Beside the same of another joint, and a column whose name is a part of the joint's."""
    name, kind = COLUMNS[column]
    other = column.replace("FL_hip", "FR_hip").replace("fl_hip", "fr_hip")
    log = table(tmp_path, **{other: np.arange(5), "hip": np.zeros(5), column: np.arange(5)})
    draft = draft_map(log, spec_of((name, UNITS[name.split("/")[1]], kind)))
    assert draft.sources[name].keys["source"] == column and not draft.sources[name].ambiguous
    assert parse_map(draft.text).channels[name].source == column


def test_a_letter_beside_a_joints_name_tells_a_position_from_a_velocity(tmp_path: Path):
    """Of two servos of one joint: the position's targets are not those of the velocity, which may never change.

    What is measured is told by words: "hip_v" may be its voltage.
    """
    columns = {
        "hip_p_cmd": np.arange(5),
        "hip_v_cmd": np.zeros(5),
        "hip_q": np.arange(5),
        "hip_dq": np.ones(5),
    }
    wanted = {
        ("hip/target", "rad", "action"): "hip_p_cmd",
        ("hip/velocity_target", "rad/s", "action"): "hip_v_cmd",
        ("hip/position", "rad", "state"): "hip_q",
        ("hip/velocity", "rad/s", "state"): "hip_dq",
        ("hip/voltage", "V", "action"): "hip_v_cmd",  # "v" is its unit, too
    }
    for channel, source in wanted.items():
        log = table(tmp_path, **columns, hip_v=np.full(5, 12.0), hip_p=np.full(5, 3.0))
        drafted = draft_map(log, spec_of(channel))
        assert drafted.sources[channel[0]].keys["source"] == source, channel
        assert not drafted.sources[channel[0]].ambiguous


@pytest.mark.parametrize("brackets", [" [{}]", "[{}]", " ({})"])
def test_a_unit_in_brackets_is_no_joint(brackets: str, tmp_path: Path):
    """Without a robot too, where the names alone tell the joints."""
    units = {"pos": "deg", "vel": "rpm", "cmd": "deg"}
    joints = ("elbow", "wrist")
    columns = {
        f"{j}_{what}{brackets.format(unit)}": np.arange(5.0) for j in joints for what, unit in units.items()
    }
    draft = draft_map(table(tmp_path, **columns))
    names = {"position": "pos", "velocity": "vel", "target": "cmd"}
    assert {c.name for c in draft.spec.channels} == {f"{j}/{name}" for j in joints for name in names}
    read = parse_map(draft.text).channels
    for joint, (name, word) in itertools.product(joints, names.items()):
        told = read[f"{joint}/{name}"]
        assert (told.source, told.unit) == (f"{joint}_{word}{brackets.format(units[word])}", units[word])


def test_joints_of_a_list_may_be_called_like_units(tmp_path: Path):
    draft = draft_map(table(tmp_path, **{f"q[{joint}]": np.arange(5.0) for joint in "ABN"}))
    assert {c.name for c in draft.spec.channels} == {f"{joint}/position" for joint in "ABN"}


def test_the_longest_joint_that_fits_has_the_column(tmp_path: Path):
    log = table(tmp_path, pos_Wrist_Pitch=np.arange(5), pos_Pitch=np.arange(5))
    spec = spec_of(("pitch/position", "rad", "state"), ("wrist_pitch/position", "rad", "state"))
    sources = draft_map(log, spec).sources
    assert [sources[c.name].keys["source"] for c in spec.channels] == ["pos_Pitch", "pos_Wrist_Pitch"]


def test_lists_without_names_go_by_their_order(tmp_path: Path):
    columns = {f"/effort_controller/commands.data[{i}]": np.arange(5) + i for i in range(3)}
    log = table(tmp_path, **columns)
    log = RawLog(log.path, log.sources, {"topics": ["/effort_controller/commands"]})
    actions = [(f"{joint}/torque", "N*m", "action") for joint in ("c", "a", "b")]
    draft = draft_map(log, spec_of(*actions))
    assert [draft.sources[a[0]].keys["source"][-3:] for a in actions] == ["[0]", "[1]", "[2]"]
    assert "check the order" in draft.text
    assert draft_map(log, spec_of(*actions[:2])).missing == ("c/torque", "a/torque")


def test_what_is_missing_ambiguous_or_derived_is_a_comment(tmp_path: Path):
    t = 0.01 * np.arange(300)
    log = table(tmp_path, pos_arm_1=np.sin(t), arm_pos_2=np.sin(t), gain=np.full(300, 3.0))
    channels = (("arm/position", "rad", "state"), ("arm/velocity", "rad/s", "state"))
    draft = draft_map(log, spec_of(*channels, ("arm/target", "rad", "action"), settings=("gain", "mass")))
    assert draft.missing == ("arm/target",) and draft.settings == ("mass",)
    assert '# [channels."arm/target"]' in draft.text and "MISSING" in draft.text
    assert "# ambiguous:" in draft.text and '# [settings."mass"]' in draft.text
    drafted = parse_map(draft.text)
    assert drafted.channels["arm/velocity"].derivative_of == "arm/position"
    assert drafted.channels["arm/velocity"].filter_hz == 20.0
    assert drafted.settings["gain"].metadata == "gain"


def units_of(log: RawLog, spec: RecordingSpec) -> dict[str, str]:
    draft = draft_map(log, spec)
    check_map(parse_map(draft.text), spec)
    return {name: source.keys["unit"] for name, source in draft.sources.items()}


def test_degrees_are_told_by_a_name_or_by_going_far_beyond_the_joints_limits(tmp_path: Path):
    """The command's limits are the joint's too."""
    t = 0.01 * np.arange(400)
    columns = {"arm_pos": 90 * np.sin(t), "arm_vel": 90 * np.cos(t), "cmd_arm": 90 * np.sin(t + 0.1)}
    log = table(tmp_path, **columns, leg_pos_deg=np.sin(t), leg_vel=np.cos(t))
    spec = spec_of(
        ("arm/position", "rad", "state"),
        ("arm/velocity", "rad/s", "state"),
        ("arm/target", "rad", "action", False, -2.0, 2.0),
        ("leg/position", "rad", "state"),
        ("leg/velocity", "rad/s", "state"),
    )
    told = units_of(log, spec)
    assert told == {
        "arm/position": "deg",
        "arm/velocity": "deg/s",
        "arm/target": "deg",
        "leg/position": "deg",
        "leg/velocity": "deg/s",
    }
    assert "beyond the joint's limits in rad: taken for degrees" in draft_map(log, spec).text


ARM_DEG = {
    "arm_pos": lambda t: 90 * np.sin(t),
    "leg_pos": lambda t: 3 * np.sin(t),
    "leg_vel": lambda t: 3 * np.cos(t),
    "cmd_leg": lambda t: 3.3 * np.sin(t),
}
TOLD_DEG = {"arm/position": "deg", "leg/position": "deg", "leg/velocity": "deg/s", "leg/target": "deg"}
MIXED = {  # what is not so in a table in degrees: what is then told
    "nothing": ({}, {}),
    "no position": ({"leg_pos": None}, {"leg/position": None}),
    "a velocity in rad/s": ({"leg_vel": lambda t: np.radians(3 * np.cos(t))}, {"leg/velocity": "rad/s"}),
    "a position in rad": (
        {
            "leg_pos": lambda t: 0.4 * np.sin(t),
            "leg_vel": lambda t: 0.4 * np.cos(t),
            "cmd_leg": lambda t: 25 * np.sin(t),
        },
        {"leg/position": "rad", "leg/velocity": "rad/s"},
    ),
    "all but a glitch": (
        {"arm_pos": lambda t: np.where(np.arange(len(t)) == 7, 4000.0, np.sin(t))},
        dict.fromkeys(("leg/position", "leg/target"), "rad") | {"leg/velocity": "rad/s"},
    ),
}


@pytest.mark.parametrize("what", MIXED)
def test_one_angle_in_degrees_tells_of_the_others_of_its_table(what: str, tmp_path: Path):
    """However little they move; but for what the same joint contradicts."""
    changed, told = MIXED[what]
    t = 0.01 * np.arange(400)
    log = table(tmp_path, **{name: of(t) for name, of in (ARM_DEG | changed).items() if of is not None})
    spec = spec_of(
        ("arm/position", "rad", "state", True, -2.0, 2.0),
        ("leg/position", "rad", "state", True, -2.0, 2.0),
        ("leg/velocity", "rad/s", "state", True),
        ("leg/target", "rad", "action"),
    )
    assert units_of(log, spec) == {n: unit for n, unit in (TOLD_DEG | told).items() if unit is not None}
    guessed = "other angles of the log are in degrees: taken for degrees too, check it"
    assert (guessed in draft_map(log, spec).text) is (what not in ("a position in rad", "all but a glitch"))


@pytest.mark.parametrize("measured", ["one position", "all positions", "all but an idle target"])
def test_targets_in_rad_tell_which_positions_are_in_degrees(measured: str, tmp_path: Path):
    """One position of the table, whose own target is far smaller; or all of them, however little one moves."""
    t = 0.01 * np.arange(400)
    arm, leg = 1.5 * np.sin(t), 0.02 * np.sin(t)  # no more than its limits in degrees, either
    told, asked = (leg if measured == "one position" else np.degrees(leg)), arm
    if (
        measured == "all but an idle target"
    ):  # the arm is moved by hand: that it is told 0 does not tell its unit
        asked, leg = 0.0 * arm, np.degrees(leg)
    log = table(tmp_path, arm_pos=np.degrees(arm), leg_pos=told, cmd_arm=asked, cmd_leg=1.1 * leg)
    spec = spec_of(
        ("arm/position", "rad", "state", True, -2.0, 2.0),
        ("leg/position", "rad", "state", True, -2.0, 2.0),
        ("arm/target", "rad", "action", True, -2.0, 2.0),
        ("leg/target", "rad", "action", True, -2.0, 2.0),
    )
    found = units_of(log, spec)
    assert found["arm/position"] == "deg" and found["arm/target"] == "rad"
    assert found["leg/target"] == ("deg" if measured == "all but an idle target" else "rad")
    assert found["leg/position"] == ("rad" if measured == "one position" else "deg")


WRITTEN = {"°": "deg", "Deg": "deg", "degrees": "deg", "radians": "rad", "mrad": "mrad"}


@pytest.mark.parametrize("unit", [*WRITTEN, "ticks"])
def test_brackets_are_read_as_headers_write_units_and_what_is_not_known_is_a_comment(
    unit: str, tmp_path: Path
):
    joints = ("elbow", "wrist")
    log = table(tmp_path, **{f"{joint} position [{unit}]": np.sin(np.arange(9.0)) for joint in joints})
    spec = spec_of(*((f"{joint}/position", "rad", "state") for joint in joints))
    assert {*units_of(log, spec).values()} == {WRITTEN.get(unit, "rad")}
    doubted = f"# [{unit}] is no unit that is known: taken for rad" in draft_map(log, spec).text
    assert doubted is (unit not in WRITTEN)
    named = table(tmp_path, **{f"position[{joint}]": np.sin(np.arange(9.0)) for joint in joints})
    one = table(tmp_path, **{"position[elbow_joint]": np.sin(np.arange(9.0))})
    for log in (named, one):
        assert "is no unit" not in draft_map(log, spec).text


def test_a_wheel_and_a_heading_turn_for_ever_and_are_no_degrees(tmp_path: Path):
    t = 0.01 * np.arange(4000)
    log = table(tmp_path, wheel_pos=10 * t, wheel_vel=10 + 0 * t, base_yaw=t)
    spec = spec_of(
        ("wheel/position", "rad", "state"),
        ("wheel/velocity", "rad/s", "state"),
        ("base/yaw", "rad", "state", False, -np.pi, np.pi),
    )
    assert units_of(log, spec) == {"wheel/position": "rad", "wheel/velocity": "rad/s", "base/yaw": "rad"}


def test_ros_has_angles_in_rad_however_large(tmp_path: Path):
    """REP 103; a winch that is wound up beyond its stops is no reason to doubt it."""
    told = truth()
    told["position"] = 100 * told["position"]
    write_robot(tmp_path / "run.mcap", told)
    spec = spec_of(*((f"{j}/position", "rad", "state", False, -2.0, 2.0) for j in JOINTS))
    assert {*units_of(read_log(tmp_path / "run.mcap"), spec).values()} == {"rad"}


def test_a_log_without_anything_of_the_robot_is_a_map_of_comments(tmp_path: Path):
    draft = draft_map(table(tmp_path, other=np.arange(5)), spec_of(("arm/position", "rad", "state")))
    assert draft.missing == ("arm/position",) and dict(parse_map(draft.text).channels) == {}


def test_a_clock_that_tells_its_unit_is_read_in_it(tmp_path: Path):
    (tmp_path / "log.csv").write_text("time_ms,pos_arm\n" + "".join(f"{10 * k},{k}\n" for k in range(50)))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.sources["pos_arm"].time, 0.01 * np.arange(50))
    spec = spec_of(("arm/position", "rad", "state"))
    recording = read_recording(tmp_path / "log.csv", spec, parse_map(draft_map(log, spec).text))
    assert recording.episodes[0].duration == pytest.approx(0.49)


STARTS = {  # (roll, pitch, yaw) at the start: what the comment says
    (0.05, -0.1, 0.0): "{} of the four",
    (0.0, 0.05, 1.5): "{} of the four",
    (0.1, 0.0, -2.0): "{} of the four",
    (np.pi / 2, np.pi / 2, 0.0): "may be the first or the last",
}


@pytest.mark.parametrize("place", ["first", "last"])
@pytest.mark.parametrize("start", STARTS)
def test_an_imu_in_lists_is_that_of_the_base(start: tuple, place: str, tmp_path: Path):
    """Whether w is first or last is told by how the robot stands; before that, the driver sent zeros."""
    turn = Rotation.from_euler(
        "ZYX", [start[::-1]] * 3 + [(a + 0.1, 0.1, 0.2) for a in np.linspace(0, 1, 30)]
    )
    quaternion = turn.as_quat(scalar_first=place == "first")
    quaternion[0] = 0.0
    columns = {f"imu_quat[{i}]": part for i, part in enumerate(quaternion.T)}
    columns |= {f"imu_gyro[{i}]": np.full(33, float(i)) for i in range(3)}
    channels = [
        (f"base/{what}", unit, "state", True) for what, unit in BASE if what[0] in "rpyw" and what != "y"
    ]
    log = table(tmp_path, **columns)
    draft = draft_map(log, spec_of(*channels))
    assert draft.missing == () and len(draft.sources) == 6
    assert STARTS[start].format(place) in draft.text
    wanted = (3, 0, 1, 2) if place == "last" and "{}" in STARTS[start] else range(4)
    for angle in ("roll", "pitch", "yaw"):
        assert draft.sources[f"base/{angle}"].keys["source"] == [f"imu_quat[{i}]" for i in wanted]
    assert draft.sources["base/wy"].keys["source"] == "imu_gyro[1]"
    assert parse_map(draft.text).channels["base/pitch"].angle == "pitch"


def test_a_list_of_four_is_no_quaternion_by_its_length(tmp_path: Path):
    """Nor is one of five by its name, nor one that was asked for."""
    names = [f"wheel_force[{i}]" for i in range(4)] + [f"quat_sums[{i}]" for i in range(5)]
    names += [f"cmd_orientation[{i}]" for i in range(4)]
    draft = draft_map(table(tmp_path, **{name: np.arange(5) for name in names}))
    assert not any("source" in s.keys and s.keys.get("angle") for s in draft.sources.values())


@pytest.mark.parametrize(
    ("logged", "flag"),
    [
        (("arm_pos", "arm_cmd"), None),
        (("/arm/joint_states.position[arm]", "/arm/command.data"), None),
        (("arm_pos", "arm_enabled"), "arm_enabled"),
        (("arm_pos", "torque_enable"), "torque_enable"),
    ],
)
def test_the_name_of_a_joint_is_neither_its_flag_nor_its_input(
    logged: tuple, flag: str | None, tmp_path: Path
):
    log = table(tmp_path, **{name: np.sin(np.arange(9.0)) for name in logged})
    log = RawLog(log.path, log.sources, {"topics": ["/arm/joint_states", "/arm/command"]})
    spec = spec_of(
        ("arm/position", "rad", "state"),
        ("arm/enabled", "1", "enable", True),
        ("arm/push", "N", "input", True),
    )
    draft = draft_map(log, spec)
    told = {name: source.keys["source"] for name, source in draft.sources.items()}
    assert told == {"arm/position": logged[0]} | ({"arm/enabled": flag} if flag else {})
    assert ("optional: nothing in the log looks like it [1]" in draft.text) is (flag is None)


@pytest.mark.parametrize(
    "topic", ["/joint_trajectory_controller/state", "/arm_controller/state", "/trajectory"]
)
@pytest.mark.parametrize(("told", "went"), [("desired", "actual"), ("reference", "feedback")])
def test_a_controller_tells_target_measurement_and_error_in_one_topic(topic, told, went, tmp_path: Path):
    """The error is neither; `output` is told in a topic of commands, but is not called so itself."""
    fields = ("error", went, told, "output")
    columns = {
        f"{topic}.{field}.{what}[{i}]": np.sin(np.arange(9.0))
        for field in fields
        for what in ("positions", "velocities")
        for i in range(2)
    }
    log = table(tmp_path, **columns)
    log = RawLog(log.path, log.sources, {"topics": [topic]})
    measured = [(f"{j}/{what}", UNITS[what], "state") for what in ("position", "velocity") for j in "ab"]
    draft = draft_map(log, spec_of(*measured, *((f"{j}/target", "rad", "action") for j in "ab")))
    for i, joint in enumerate("ab"):
        sources = [
            draft.sources[f"{joint}/{what}"].keys["source"] for what in ("position", "velocity", "target")
        ]
        assert sources == [
            f"{topic}.{field}[{i}]"
            for field in (f"{went}.positions", f"{went}.velocities", f"{told}.positions")
        ]


def test_a_filter_is_that_of_the_numbers_not_of_the_rows(tmp_path: Path):
    """A position at 20 Hz among commands at 100 Hz, with empty cells where the other has a number."""
    t = 0.01 * np.arange(500)
    positions = np.where(np.arange(500) % 5 == 0, np.sin(t), np.nan)
    log = table(tmp_path, arm_pos=positions, arm_cmd=np.sin(t))
    draft = draft_map(log, spec_of(("arm/position", "rad", "state"), ("arm/velocity", "rad/s", "state")))
    assert draft.sources["arm/velocity"].keys["filter_hz"] == 4.0


def test_an_acceleration_is_no_velocity(tmp_path: Path):
    t = 0.01 * np.arange(50)
    log = table(tmp_path, q_arm=np.sin(t), q_ddot_arm=-np.sin(t))
    draft = draft_map(log, spec_of(("arm/position", "rad", "state"), ("arm/velocity", "rad/s", "state")))
    assert draft.sources["arm/velocity"].keys["derivative_of"] == "arm/position"


@pytest.mark.parametrize("column", ["left", "left_deg", "left [deg]", "left_state"])
def test_a_bare_name_of_a_joint_is_its_position_and_nothing_else(column: str, tmp_path: Path):
    """One signal serves one channel: the velocity is derived, and no torque is measured."""
    t = 0.01 * np.arange(300)
    log = table(tmp_path, **{"left_ref": np.sin(t), column: np.sin(t)})
    kinds = (("position", "rad", "state"), ("velocity", "rad/s", "state"), ("target", "rad", "action"))
    draft = draft_map(log, spec_of(*((f"left/{what}", unit, kind) for what, unit, kind in kinds)))
    assert draft.sources["left/position"].keys["source"] == column
    assert draft.sources["left/velocity"].keys["derivative_of"] == "left/position"
    assert draft.sources["left/target"].keys["source"] == "left_ref"
    assert not draft_map(log, spec_of(("left/torque", "N*m", "state"))).sources


def test_the_unit_of_a_bare_name_tells_what_it_measures(tmp_path: Path):
    log = table(
        tmp_path, **{"arm [rad/s]": np.arange(5.0), "leg_rpm": np.arange(5.0), "toe [N]": np.arange(5.0)}
    )
    units = {"arm": ("velocity", "rad/s"), "leg": ("velocity", "rad/s"), "toe": ("torque", "N")}
    spec = spec_of(*((f"{joint}/{what}", unit, "state") for joint, (what, unit) in units.items()))
    assert draft_map(log, spec).missing == ()
    positions = spec_of(*((f"{joint}/position", "rad", "state") for joint in units))
    assert not draft_map(log, positions).sources


def test_flags_and_inputs_may_share_a_signal_where_states_do_not(tmp_path: Path):
    log = table(tmp_path, enable=np.ones(5), pos=np.arange(5.0))
    flags = [(f"{joint}/enable", "1", "enable") for joint in "ab"]
    assert {s.keys["source"] for s in draft_map(log, spec_of(*flags)).sources.values()} == {"enable"}
    twice = spec_of(("arm/position", "rad", "state"), ("arm/angle", "rad", "state"))
    assert [*draft_map(log, twice).sources] == ["arm/position"]


CART = (("rail/position", "m", "state"), ("rail/velocity", "m/s", "state"), ("rail/torque", "N", "action"))
LONE = {  # {columns: that of the command, what is said of it}
    ("force [N]", "rail [m]"): ("force [N]", "measured"),
    ("command", "rail [m]"): ("command", ""),
    ("cmd_grip", "rail [m]", "load"): ("cmd_grip", "the only command"),
    ("drive", "rail [m]"): ("drive", "the only column left: check it"),
    ("u", "rail_pos"): ("u", ""),
    ("u_rail", "rail_pos"): ("u_rail", ""),
    ("u1", "rail_pos"): ("u1", "by its place"),
    ("u[0]", "rail_pos"): ("u[0]", "by its place"),
    ("drive", "load", "rail [m]"): (None, ""),
    ("drive [V]", "rail [m]"): (None, ""),
    ("temp", "rail [m]"): (None, ""),
    ("drive",): (None, ""),
}


@pytest.mark.parametrize("columns", LONE)
def test_the_only_drive_has_the_only_command(columns: tuple, tmp_path: Path):
    """Or the only column left, whose unit fits; numbers of rows are none."""
    numbers = np.random.default_rng(1).normal(size=(len(columns), 50))
    log = table(tmp_path, **dict(zip(columns, numbers, strict=True)), row=np.arange(50.0))
    wanted, said = LONE[columns]
    source = draft_map(log, spec_of(*CART)).sources.get("rail/torque")
    assert (source and source.keys["source"]) == wanted
    assert source is None or said in " ".join(source.notes) and bool(said) == bool(source.notes)


def test_a_drive_that_measures_its_current_in_three_phases_is_told_nothing(tmp_path: Path):
    log = table(tmp_path, **{f"arm_current_{phase}": np.arange(5.0) for phase in "uvw"})
    assert not any(o.command for o in offers_of(log))


def test_commands_of_several_joints_may_be_called_u(tmp_path: Path):
    actions = [(f"{joint}/torque", "N*m", "action") for joint in ("left", "right")]
    for first, second in (("u_left", "u_right"), ("u1", "u2"), ("u[0]", "u[1]")):
        log = table(tmp_path, **{first: np.arange(5.0), second: np.arange(5.0) ** 2})
        sources = draft_map(log, spec_of(*actions)).sources
        assert [sources[name].keys["source"] for name, *_ in actions] == [first, second]


ASKED = {  # {case: (how far the positions and targets go, by how much they are rounded, the unit that is told)}
    "counts of 0.088 deg": (646.0, 1.0, "rad"),
    "commands between counts": (646.0, 0.01, "rad"),
    "whole numbers": (90.0, 1.0, "rad"),
    "degrees": (90.0, 0.1, "deg"),
    "degrees a little beyond the stops": (160.0, 0.1, "deg"),
    "few steps": (90.0, 30.0, "deg"),
}


@pytest.mark.parametrize("case", ASKED)
def test_what_is_no_angle_in_degrees_either_is_asked_about(case: str, tmp_path: Path):
    """The counts of an encoder are no degrees; whole numbers may be either."""
    size, step, unit = ASKED[case]
    moved = np.round(size * np.sin(0.01 * np.arange(400)) / step) * step
    log = table(tmp_path, arm_pos=moved, arm_cmd=0.9 * moved if step < 1 else moved)
    spec = RecordingSpec(
        "robot",
        (
            ChannelSpec("arm/position", "rad", "state", stops=(-2.5, 2.5)),
            ChannelSpec("arm/target", "rad", "action", stops=(-2.5, 2.5)),
        ),
        (),
        100.0,
    )
    draft = draft_map(log, spec)
    assert units_of(log, spec) == {"arm/position": unit, "arm/target": unit}
    asked = "counts of an encoder? set scale = ... (radians per count)"
    assert draft.text.count(asked) == (2 if unit == "rad" else 0)
    assert ('or unit = "deg"' in draft.text) == (case == "whole numbers")

"""Messages read back from MCAP, rosbag2 and ROS 1 files are the numbers that were written."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_typestore

from dynreg.data.ingest import doctor
from dynreg.data.readers import ReadOptions, format_of, read_log
from dynreg.data.readers.messages import leaves
from dynreg.errors import LogError, MapError

START = 1_700_000_000_123_456_789  # ns
STEP = 5_000_000
ANGLES = np.random.default_rng(3).normal(size=(40, 2))


def joint_state(store, k: int, stamp: int, **header_extra):
    types = store.types
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9),
        frame_id="",
        **header_extra,
    )
    order = [0, 1] if k % 2 == 0 else [1, 0]  # joints change places: only their names tell
    return types["sensor_msgs/msg/JointState"](
        header=header,
        name=[["elbow", "wrist"][i] for i in order],
        position=ANGLES[k][order],
        velocity=2 * ANGLES[k][order],
        effort=np.array([]),
    )


def write_cdr_mcap(path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    text, _ = store.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", text.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k in range(len(ANGLES)):
            stamp = START + k * STEP
            data = bytes(store.serialize_cdr(joint_state(store, k, stamp), "sensor_msgs/msg/JointState"))
            writer.add_message(channel, stamp + 700_000, data, stamp)
        writer.finish()


def write_bag2(path: Path, plugin: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Bag2(path, version=9, storage_plugin=plugin) as bag:
        connection = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(len(ANGLES)):
            stamp = START + k * STEP
            message = joint_state(store, k, stamp)
            bag.write(connection, stamp + 700_000, store.serialize_cdr(message, connection.msgtype))


def write_bag1(path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Bag1(path) as bag:
        connection = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(len(ANGLES)):
            stamp = START + k * STEP
            message = joint_state(store, k, stamp, seq=k)
            bag.write(connection, stamp + 700_000, store.serialize_ros1(message, connection.msgtype))


WRITERS = {
    "run.mcap": write_cdr_mcap,
    "bag2_db3": lambda p: write_bag2(p, StoragePlugin.SQLITE3),
    "bag2_mcap": lambda p: write_bag2(p, StoragePlugin.MCAP),
    "run.bag": write_bag1,
}


@pytest.mark.parametrize("name", WRITERS)
def test_joint_states_by_name_on_header_stamps(name: str, tmp_path: Path):
    path = tmp_path / name
    WRITERS[name](path)
    log = read_log(path)
    for i, joint in enumerate(("elbow", "wrist")):
        series = log.sources[f"/joint_states.position[{joint}]"]
        np.testing.assert_array_equal(series.values, ANGLES[:, i])
        np.testing.assert_array_equal(
            log.sources[f"/joint_states.velocity[{joint}]"].values, 2 * ANGLES[:, i]
        )
        # 0.7 ms before the log's first stamp, 5 ms apart, to the nanosecond
        np.testing.assert_allclose(series.time, -0.0007 + 0.005 * np.arange(40), atol=1e-12)
    assert log.sources["/joint_states.position[0]"].values[1] == ANGLES[1, 1]
    assert (log.metadata["messages_read"], log.metadata["messages_lost"]) == (40, 0)
    assert log.findings == ()


def test_single_db3_file(tmp_path: Path):
    write_bag2(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = (tmp_path / "bag").glob("*.db3")
    assert len(read_log(file).sources["/joint_states.position[elbow]"]) == 40


def test_log_time_on_request(tmp_path: Path):
    write_cdr_mcap(tmp_path / "run.mcap")
    series = read_log(tmp_path / "run.mcap", ReadOptions(time="log")).sources["/joint_states.position[elbow]"]
    assert series.time[0] == 0.0


def test_a_column_is_no_clock_of_messages(tmp_path: Path):
    write_cdr_mcap(tmp_path / "run.mcap")
    with pytest.raises(MapError, match="a log of messages, and the map names column 't_s' as its clock"):
        read_log(tmp_path / "run.mcap", ReadOptions(time="t_s"))


def write_json_mcap(path: Path, messages: list[dict], topic: str = "/arm", encoding: str = "json") -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        channel = writer.register_channel(topic, encoding, schema)
        for k, message in enumerate(messages):
            writer.add_message(channel, START + k * STEP, json.dumps(message).encode(), 0)
        writer.finish()


def test_json_leaves_are_numbers_only(tmp_path: Path):
    messages = [
        {"q": [k, -k], "on": True, "text": "x", "image": [0] * 65, "deep": {"v": k / 2}} for k in range(5)
    ]
    write_json_mcap(tmp_path / "j.mcap", messages)
    log = read_log(tmp_path / "j.mcap")
    assert set(log.sources) == {"/arm.q[0]", "/arm.q[1]", "/arm.on", "/arm.deep.v"}
    np.testing.assert_array_equal(log.sources["/arm.q[1]"].values, [0, -1, -2, -3, -4])
    np.testing.assert_array_equal(log.sources["/arm.on"].values, 1.0)


def test_fields_that_come_and_go_keep_their_own_stamps(tmp_path: Path):
    write_json_mcap(tmp_path / "j.mcap", [{"a": k} if k % 2 else {"b": [k]} for k in range(6)])
    log = read_log(tmp_path / "j.mcap")
    np.testing.assert_allclose(log.sources["/arm.a"].time, [0.005, 0.015, 0.025])
    np.testing.assert_array_equal(log.sources["/arm.b[0]"].values, [0, 2, 4])


def test_header_of_another_clock_is_shifted_and_told(tmp_path: Path):
    messages = [{"header": {"stamp": {"sec": 0, "nanosec": (k + 1) * STEP}}, "v": k} for k in range(5)]
    write_json_mcap(tmp_path / "sim_time.mcap", messages)
    log = read_log(tmp_path / "sim_time.mcap")
    np.testing.assert_allclose(log.sources["/arm.v"].time, 0.005 * np.arange(5), atol=1e-6)
    assert [f.check for f in log.findings] == ["clock"]


def two_topics(path: Path, ahead: float, more: float = 0.0) -> None:
    """A topic whose headers are ahead of the recorder [s], one of them later by `more`, and one without headers."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        names = ("/joint", "/odom", "/told")
        joint, odom, told = (writer.register_channel(name, "json", schema) for name in names)
        for k in range(5):
            logged = START + k * STEP
            for channel, late in ((joint, 0.0), (odom, more), (told, None)):
                stamp = logged if late is None else logged + round((ahead - late) * 1e9)
                head = {"header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}}
                message = {"v": k} | ({} if late is None else head)
                writer.add_message(channel, logged, json.dumps(message).encode(), 0)
        writer.finish()


@pytest.mark.parametrize(
    ("ahead", "said"), [(5.0, "shifted by 5 s"), (0.2, "delay = -0.2"), (0.02, ""), (-0.3, "")]
)
def test_a_header_clock_that_is_ahead_is_put_right_or_told(tmp_path: Path, ahead: float, said: str):
    two_topics(tmp_path / "a.mcap", ahead)
    log = read_log(tmp_path / "a.mcap")
    joint, told = (log.sources[f"/{name}.v"].time[0] for name in ("joint", "told"))
    if "delay" in said:  # what is advised brings them together
        told -= -0.2
    assert joint - told == pytest.approx(0.0 if said else ahead, abs=1e-6)
    found = [f.told for f in log.findings if f.check == "clock"]
    assert all(said in text for text in found) and bool(found) == bool(said)


def test_headers_of_one_clock_are_shifted_together(tmp_path: Path):
    two_topics(tmp_path / "a.mcap", 5.0, 0.19)
    log = read_log(tmp_path / "a.mcap")
    assert log.sources["/joint.v"].time[0] == pytest.approx(0.0, abs=1e-6)
    assert log.sources["/odom.v"].time[0] == pytest.approx(-0.19, abs=1e-6)


def test_protobuf_messages(tmp_path: Path):
    from google.protobuf.wrappers_pb2 import DoubleValue
    from mcap_protobuf.writer import Writer as ProtoWriter

    with (tmp_path / "p.mcap").open("wb") as file, ProtoWriter(file) as writer:
        for k in range(4):
            writer.write_message("/torque", DoubleValue(value=k + 0.5), START + k * STEP, 0)
    np.testing.assert_array_equal(
        read_log(tmp_path / "p.mcap").sources["/torque.value"].values, [0.5, 1.5, 2.5, 3.5]
    )


def test_topics_that_the_map_does_not_ask_for_are_not_decoded(tmp_path: Path):
    for name, write in WRITERS.items():
        write(tmp_path / name)
        log = read_log(tmp_path / name, ReadOptions(sources=("/imu.x",)))
        assert log.sources == {} and log.metadata["topics"] == ["/joint_states"]
        log = read_log(tmp_path / name, ReadOptions(sources=("/joint_states.position[elbow]",)))
        np.testing.assert_array_equal(log.sources["/joint_states.position[elbow]"].values, ANGLES[:, 0])


def test_unknown_encoding_is_told(tmp_path: Path):
    write_json_mcap(tmp_path / "c.mcap", [{"v": 1}], encoding="cbor")
    with pytest.raises(LogError, match="no message that can be read"):
        read_log(tmp_path / "c.mcap")


def test_bag_without_index_is_a_clear_error(tmp_path: Path):
    write_bag1(tmp_path / "run.bag")
    data = (tmp_path / "run.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: len(data) // 2])
    with pytest.raises(LogError, match="cut.bag.*rosbag reindex"):
        read_log(tmp_path / "cut.bag")


def test_format_by_magic_bytes_not_suffix(tmp_path: Path):
    write_cdr_mcap(tmp_path / "run.dat")
    assert format_of(tmp_path / "run.dat").name == "mcap"
    (tmp_path / "notes.txt").write_text("no log")
    with pytest.raises(LogError, match="no known format"):
        read_log(tmp_path / "notes.txt")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(LogError, match="is empty"):
        read_log(tmp_path / "empty.csv")


def test_leaves_stop_at_depth():
    nested: dict = {"v": 1.0}
    for _ in range(1000):
        nested = {"n": nested}
    assert list(leaves(nested)) == []


def test_a_topic_of_another_host_is_not_shifted_with_the_robots_clock(tmp_path: Path):
    two_topics(tmp_path / "a.mcap", 5.0, 5.0)  # the headers of /odom agree with the recorder
    log = read_log(tmp_path / "a.mcap")
    begins = [log.sources[f"/{name}.v"].time[0] for name in ("joint", "odom", "told")]
    assert begins == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("late", [0, 1])
def test_two_drivers_on_one_topic_have_a_clock_each(late: int, tmp_path: Path):
    """The gripper's stamps are older than the arm's; a clock that itself runs back is an error still."""
    messages = []
    for k in range(200):
        stamp = START + (k - 3 * (k % 2)) * STEP - (late if k == 100 else 0) * 7 * STEP
        told = {"header": {"seq": k // 2, "stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}}
        told |= {"name": ["gripper"] if k % 2 else ["elbow", "wrist"]}
        messages.append(told | {"position": [np.sin(0.01 * k)] * len(told["name"])})
    write_json_mcap(tmp_path / "j.mcap", messages, "/joint_states")
    found = doctor(tmp_path / "j.mcap")
    (said,) = [f for f in found if f.severity == "info"]
    assert said.check == "clock" and said.where == "j.mcap, /joint_states"
    assert "2 senders share it" in said.told and "[elbow, wrist] and [gripper]" in said.told
    assert [f.check for f in found if f.severity != "info"] == ["clock"] * late
    assert not any("header" in f.where or "position[0]" in f.where for f in found)

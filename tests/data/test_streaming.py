"""Large logs are read piece by piece: the same numbers as at once, and no more memory than a piece takes."""

import io
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag
from rosbags.typesys import Stores, get_typestore
from test_message_readers import ANGLES, START, STEP, joint_state

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions, parquet, read_log, tables

ONLY_Q = ReadOptions(sources=("/arm.q",))


def with_images(count: int, size: int, chunk_size: int, every: int = 10) -> bytes:
    """An MCAP file of `count` joint messages, images of `size` bytes after so many of them, a tenth of their number."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=chunk_size, compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("thing", "jsonschema", b"{}")
    arm, camera = (writer.register_channel(topic, "json", schema) for topic in ("/arm", "/camera"))
    for k in range(count):
        writer.add_message(arm, k * 10**7, json.dumps({"q": k, "w": [-k, k]}).encode(), 0)
        for _ in range(every // 10 if k % every == every - 1 else 0):
            writer.add_message(camera, k * 10**7, b'{"image": "' + bytes([48 + k % 10]) * size + b'"}', 0)
    writer.finish()
    return file.getvalue()


def test_images_beside_the_joints_take_no_memory_but_a_chunk() -> None:
    data = with_images(400, 1_000_000, 4_000_000)
    read_log(LogFile(Path("run.mcap"), data), ONLY_Q)  # what is loaded once is not counted
    tracemalloc.start()
    log = read_log(LogFile(Path("run.mcap"), data), ONLY_Q)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(log.sources["/arm.q"].values, np.arange(400))
    assert set(log.names) == {"/arm.q", "/arm.w[0]", "/arm.w[1]"}
    assert log.metadata["messages_read"] == 440 and log.findings == ()
    assert peak < 16_000_000  # the file holds 40 MB of images


def test_a_chunk_without_a_topic_that_is_asked_for_is_not_unpacked() -> None:
    data = bytearray(with_images(400, 30_000, 20_000, every=100))
    chunks = make_reader(io.BytesIO(data)).get_summary().chunk_indexes
    camera_only = [c for c in chunks if len(c.message_index_offsets) == 1 and 2 in c.message_index_offsets]
    mixed = [c for c in chunks if 1 in c.message_index_offsets]
    assert len(camera_only) > 5 and len(camera_only) + len(mixed) == len(chunks)
    for chunk in camera_only:
        middle = chunk.chunk_start_offset + chunk.chunk_length // 2
        data[middle : middle + 8] = bytes(8)
    log = read_log(LogFile(Path("run.mcap"), bytes(data)), ONLY_Q)
    np.testing.assert_array_equal(log.sources["/arm.q"].values, np.arange(400))
    assert log.findings == () and log.metadata["messages_read"] == 440
    assert log.metadata["topics"] == ["/arm", "/camera"]
    lost = read_log(LogFile(Path("run.mcap"), bytes(data))).findings
    assert any(finding.check == "lost" for finding in lost)


CELLS = {
    "whole, then fractions": (["1", "2", "3", "4.5", "5.5", "6.5"], [1, 2, 3, 4.5, 5.5, 6.5]),
    "empty, then whole": (["", "", "", "4", "5", "6"], [np.nan] * 3 + [4, 5, 6]),
    "whole, then empty": (["1", "2", "3", "", "", ""], [1, 2, 3] + [np.nan] * 3),
    "flags, then whole": (["true", "false", "true", "0", "1", "0"], None),
    "whole, then text": (["01", "2", "3", "d", "e", "f"], None),
    "text, then whole": (["a", "b", "c", "4", "5", "06"], None),
}


@pytest.mark.parametrize("kind", CELLS)
def test_a_csv_file_in_blocks_is_that_at_once(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cells, numbers = CELLS[kind]
    stamps = [1_700_000_000_000_000_001 + i for i in range(6)]
    text = "time,q\n" + "".join(f"{t},{c}\n" for t, c in zip(stamps, cells, strict=True))
    options = ReadOptions(time_unit="ns")
    monkeypatch.setattr(tables, "BLOCK", 60)
    log = read_log(LogFile(Path("run.csv"), text.encode()), options)
    if numbers is not None:
        np.testing.assert_array_equal(log.sources["q"].values, numbers)
        np.testing.assert_allclose(log.sources["q"].time, np.arange(6) * 1e-9, rtol=1e-12)
    elif kind.startswith("flags"):
        np.testing.assert_array_equal(log.sources["q"].values, [1, 0, 1, 0, 1, 0])
    else:
        assert log.labels["q"].tolist() == cells


def test_dates_in_blocks_of_two_kinds_are_one_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    stamps = [f"2024-01-01T00:00:0{i}" for i in range(4)] + [f"2024-01-01T00:00:0{i}.5" for i in range(4, 8)]
    text = "time,q\n" + "".join(f"{t},1\n" for t in stamps)
    monkeypatch.setattr(tables, "BLOCK", 60)
    time = read_log(LogFile(Path("run.csv"), text.encode())).sources["q"].time
    np.testing.assert_allclose(time, [0, 1, 2, 3, 4.5, 5.5, 6.5, 7.5], atol=1e-6)


def test_a_parquet_file_in_batches_is_that_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = {
        "time": pa.array([None if i == 7 else 1_700_000_000_000_000_001 + i for i in range(100)]),
        "q": pa.array([[k] * (k % 4) for k in range(100)], pa.list_(pa.int64())),
        "who": pa.array([None if k == 50 else "ab"[k % 2] for k in range(100)]),
        "never": pa.nulls(100),
    }
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file, row_group_size=30)
    log = LogFile(Path("run.parquet"), file.getvalue())
    options = ReadOptions(time_unit="ns")
    whole = read_log(log, options)
    monkeypatch.setattr(parquet, "_ROWS", 7)
    pieces = read_log(log, options)
    assert whole.sources.keys() == pieces.sources.keys() == {"q[0]", "q[1]", "q[2]", "never"}
    for name, series in whole.sources.items():
        np.testing.assert_array_equal(pieces.sources[name].values, series.values)
        np.testing.assert_array_equal(pieces.sources[name].time, series.time)
    assert whole.labels["who"].tolist() == pieces.labels["who"].tolist()
    assert whole.labels["who"][50] == ""
    np.testing.assert_array_equal(whole.sources["q[1]"].values[[1, 2, 3]], [np.nan, 2, 3])


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_packed_rosbag2_folder_is_unpacked(
    mode: CompressionMode, plugin: StoragePlugin, tmp_path: Path
) -> None:
    if (mode, plugin) == (CompressionMode.MESSAGE, StoragePlugin.MCAP):
        pytest.skip("ROS 2 packs the chunks of an MCAP, not its messages")
    store = get_typestore(Stores.ROS2_HUMBLE)
    bag = Bag(tmp_path / "bag", version=9, storage_plugin=plugin)
    bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        connection = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k in range(len(ANGLES)):
            stamp = START + k * STEP
            data = store.serialize_cdr(joint_state(store, k, stamp), "sensor_msgs/msg/JointState")
            bag.write(connection, stamp, data)
    log = read_log(tmp_path / "bag")
    np.testing.assert_array_equal(log.sources["/joint_states.position[elbow]"].values, ANGLES[:, 0])
    assert log.findings == ()


def test_a_db3_file_is_the_one_that_its_path_names(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Bag(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connection = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        bag.write(
            connection, START, store.serialize_cdr(joint_state(store, 0, START), "sensor_msgs/msg/JointState")
        )
    (file,) = (tmp_path / "bag").glob("*.db3")
    path = file.rename(tmp_path / "run 1:2?mode=memory#x%41.db3")
    assert len(read_log(path).sources["/joint_states.position[elbow]"]) == 1

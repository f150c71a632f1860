"""No log, however small, asks for more than the limits: one line names the limit and the variable that sets it."""

import io
import json
import os
import re
import sqlite3
import struct
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from scipy.io import savemat
from test_message_readers import write_bag1

from dynreg.data.logfile import LogFile
from dynreg.data.maps import parse_map, read_map
from dynreg.data.patterns import search
from dynreg.data.readers import ReadOptions, read_log
from dynreg.errors import LogError, MapError
from dynreg.limits import Limits, variable

T = np.arange(100) * 0.01
NEXT = "=" * 80 + "\n"


def mcap(
    schema: bytes, kind: str, encoding: str, *messages: bytes, name: str = "x/msg/A", **options: object
) -> LogFile:
    """An MCAP log of one topic."""
    file = io.BytesIO()
    writer = Writer(file, **options)
    writer.start()
    channel = writer.register_channel("/t", encoding, writer.register_schema(name, kind, schema))
    for k, message in enumerate(messages):
        writer.add_message(channel, k * 10**7, message, 0)
    writer.finish()
    return LogFile(Path("run.mcap"), file.getvalue())


def table(**columns: object) -> LogFile:
    """A Parquet log."""
    file = io.BytesIO()
    pq.write_table(pa.table({"time": T, **columns}), file)
    return LogFile(Path("run.parquet"), file.getvalue())


def matlab(packed: bool) -> LogFile:
    """A .mat log of 6 vectors."""
    file = io.BytesIO()
    savemat(file, {"t": T, **{f"q{k}": T for k in range(5)}}, do_compression=packed)
    return LogFile(Path("run.mat"), file.getvalue())


def numbers(count: int, **options: object) -> LogFile:
    """An MCAP log of `count` JSON messages."""
    messages = (json.dumps({"q": k, "w": -k}).encode() for k in range(count))
    return mcap(b"{}", "jsonschema", "json", *messages, **options)


CSV = LogFile(Path("run.csv"), b"time,q,w\n" + b"".join(b"%d,1,2\n" % k for k in range(100)))
BENCH = LogFile(Path("run.json"), json.dumps({"entries": [{"t": k, "q": k} for k in range(100)]}).encode())
LIMITED: list[tuple[str, int, Callable[[], LogFile]]] = [
    ("rows", 99, lambda: CSV),
    ("rows", 99, lambda: table(q=T)),
    ("columns", 2, lambda: CSV),
    ("columns", 1, lambda: table(q=T)),
    ("columns", 3, lambda: matlab(True)),
    ("columns", 1, lambda: numbers(3)),
    ("columns", 1, lambda: BENCH),
    ("numbers", 299, lambda: CSV),
    ("numbers", 199, lambda: table(q=T)),
    ("numbers", 299, lambda: table(q=[[1.0, 2.0]] * 100)),
    ("numbers", 299, lambda: table(q=["x" * 9000] * 100)),
    ("numbers", 599, lambda: matlab(False)),
    ("numbers", 199, lambda: numbers(100)),
    ("numbers", 199, lambda: BENCH),
    ("messages", 99, lambda: numbers(100)),
    ("chunk_bytes", 500, lambda: matlab(True)),
    ("chunk_bytes", 500, lambda: LogFile(Path("run.csv"), b"time,q\n" + b"1" * (33 << 20))),
    ("unpacked_bytes", 2000, lambda: numbers(100, chunk_size=500)),
    ("unpacked_bytes", 800, lambda: table(q=T)),
    ("whole_bytes", 3000, lambda: matlab(True)),
    ("whole_bytes", 3000, lambda: matlab(False)),
    ("json_bytes", 100, lambda: BENCH),
]


@pytest.mark.parametrize(("limit", "allowed", "log"), LIMITED, ids=lambda x: x if isinstance(x, str) else "")
def test_past_a_limit_one_line_names_it(
    limit: str, allowed: int, log: Callable[[], LogFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    if limit != "chunk_bytes":  # a line of 33 MB is none anyway
        assert read_log(log()).names
    monkeypatch.setenv(f"DYNREG_MAX_{limit.upper()}", str(allowed))
    with pytest.raises(
        LogError, match=rf"'run\.\w+' asks for more .*DYNREG_MAX_{limit.upper()} higher"
    ) as error:
        read_log(log())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_past_the_limit_is_left_out_and_told(
    compression: CompressionType, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = numbers(100, compression=compression)
    monkeypatch.setenv("DYNREG_MAX_CHUNK_BYTES", "3000")
    read = read_log(log)
    assert 0 < len(read.sources["/t.q"]) < 100
    assert "DYNREG_MAX_CHUNK_BYTES allows 3000" in str(read.findings[0])


def test_a_zstd_chunk_is_unpacked_no_further_than_the_limit() -> None:
    whole, size = numbers(1).data, 1 << 30
    pack = zstandard.ZstdCompressor(level=1).compressobj()
    packed = b"".join(pack.compress(bytes(1 << 24)) for _ in range(size >> 24)) + pack.flush()
    chunk = struct.pack("<QQQII", 0, 10, size, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    end = whole.index(b"\x0f" + struct.pack("<Q", 4))
    data = whole[:end] + b"\x06" + struct.pack("<Q", len(chunk)) + chunk + whole[end:]
    began = time.process_time()
    log = read_log(LogFile(Path("bomb.mcap"), data))
    assert "DYNREG_MAX_CHUNK_BYTES" in str(log.findings[0]) and len(log.sources["/t.q"]) == 1
    assert time.process_time() - began < 20


def _recursive() -> LogFile:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    described = FileDescriptorSet()
    file = described.file.add(name="a.proto", syntax="proto3")
    node = file.message_type.add(name="Node")
    for i in range(8):
        node.field.add(name=f"c{i}", number=i + 1, type=11, label=1, type_name=".Node")
    node.field.add(name="v", number=20, type=1, label=1)
    data = b"\xa1\x01" + struct.pack("<d", 1.5)
    inside = b"\x0a" + bytes([len(data)]) + data
    return mcap(described.SerializeToString(), "protobuf", "protobuf", data, inside + data, name="Node")


def test_a_protobuf_type_that_holds_itself_gives_what_was_sent_and_no_more() -> None:
    log = read_log(_recursive())
    assert {name: len(series) for name, series in log.sources.items()} == {"/t.v": 2, "/t.c0.v": 1}


NOT_READ = {
    "an array of a billion types": ("B[1000000000] b\n" + NEXT + "MSG: x/B\nfloat64 v\n", bytes(100)),
    "arrays in arrays in arrays": (
        "B[1000] b\n" + "".join(f"{NEXT}MSG: x/{a}\n{b}[1000] b\n" for a, b in zip("BCD", "CDE", strict=True))
        + f"{NEXT}MSG: x/E\nuint8[0] v\n",
        bytes(100),
    ),
    "lists in lists of nothing": (
        f"B[] b\n{NEXT}MSG: x/B\nC[] c\n{NEXT}MSG: x/C\nuint8[0] v\n",
        struct.pack("<I", 1000) + struct.pack("<I", 4000) * 1000,
    ),
    "a type that holds itself": ("x/A a\nfloat64 v\n", bytes(100)),
    "two types that hold each other": (f"B[] b\n{NEXT}MSG: x/B\nA[] a\n", bytes(100)),
    "a hundred million texts": ("string[100000000] b\n", bytes(100)),
}  # fmt: skip


@pytest.mark.parametrize("title", NOT_READ)
@pytest.mark.parametrize(("kind", "encoding"), [("ros2msg", "cdr"), ("ros1msg", "ros1")])
def test_a_ros_type_without_end_is_not_built(title: str, kind: str, encoding: str) -> None:
    text, data = NOT_READ[title]
    began = time.process_time()
    with pytest.raises(
        LogError, match="no message that can be read .*(arrays of more|holds itself|no bytes)"
    ):
        read_log(mcap(text.encode(), kind, encoding, (b"\0\1\0\0" if encoding == "cdr" else b"") + data))
    assert time.process_time() - began < 5


def test_a_ros_message_of_too_many_items_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"B[] b\nfloat64 v\n{NEXT}MSG: x/B\nuint8 v\n"
    messages = [struct.pack("<d", 1.0).join((struct.pack("<I", n) + bytes(n), b"")) for n in (8, 100_000)]
    monkeypatch.setenv("DYNREG_MAX_ITEMS", "50000")
    log = read_log(mcap(text.encode(), "ros1msg", "ros1", *messages))
    np.testing.assert_array_equal(log.sources["/t.v"].values, [1.0])
    assert "DYNREG_MAX_ITEMS" in str(log.findings[0])


def test_a_view_in_the_place_of_a_table_is_not_asked(tmp_path: Path) -> None:
    database = sqlite3.connect(tmp_path / "run.db3")
    database.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)")
    database.execute(
        "CREATE VIEW messages AS WITH RECURSIVE c (x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"
        " SELECT x AS id, 1 AS topic_id, x AS timestamp, x'00' AS data FROM c"
    )
    database.commit()
    database.close()
    with pytest.raises(LogError, match="no tables of topics and messages"):
        read_log(tmp_path / "run.db3")


def test_a_chunk_of_a_ros_1_bag_is_unpacked_no_further(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosbags.rosbag1 import Writer as Bag

    def packed(self: Bag, path: Path, plain: Callable = Bag.__init__) -> None:
        plain(self, path)
        self.set_compression(Bag.CompressionFormat.BZ2)

    monkeypatch.setattr(Bag, "__init__", packed)
    write_bag1(tmp_path / "run.bag")
    assert read_log(tmp_path / "run.bag").sources
    monkeypatch.setenv("DYNREG_MAX_CHUNK_BYTES", "100")
    with pytest.raises(LogError, match="DYNREG_MAX_CHUNK_BYTES"):
        read_log(tmp_path / "run.bag")


def test_one_long_text_in_many_rows_is_kept_once() -> None:
    texts = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100, np.int32)), pa.array(["x" * 3_000_000]))
    labels = read_log(table(q=T, who=texts)).labels["who"]
    assert len({id(text) for text in labels}) == 1 and len(labels) == 100


def test_images_in_lists_are_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DYNREG_MAX_NUMBERS", "1000")
    log = read_log(table(q=T, image=[[0.0] * 5000] * 100))
    assert set(log.sources) == {"q"}


NESTED = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30))
FILES = "rosbag2_bagfile_information:\n  relative_file_paths: *a29\n"


@pytest.mark.parametrize(
    "text", ["k: [1, 2]\n" * 200_000, f"a0: &a0 [x]\n{NESTED}{FILES}"], ids=["long", "nested"]
)
def test_a_metadata_file_is_read_as_far_as_it_is_one(text: str, tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(LogError, match="DYNREG_MAX_SETTINGS_BYTES|no files are listed"):
        read_log(tmp_path)


def test_a_dataset_of_too_many_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("{}")
    (tmp_path / "data").mkdir()
    for k in range(4):
        pq.write_table(pa.table({"timestamp": T, "q": T}), tmp_path / "data" / f"{k}.parquet")
    assert len(read_log(tmp_path).sources["q"]) == 400
    monkeypatch.setenv("DYNREG_MAX_LOG_FILES", "3")
    with pytest.raises(LogError, match="DYNREG_MAX_LOG_FILES"):
        read_log(tmp_path)


def test_patterns_are_searched_for_a_limited_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert search("kp(\\d+)", "steps_kp400").found == "400"
    assert search("(?:kp|kd)_?([0-9]+)$", "steps_kp_400").found == "400"
    assert search("(kp", "").problem and search("(" * 3000 + ")" * 3000, "").problem
    monkeypatch.setenv("DYNREG_MAX_PATTERN_SECONDS", "1")
    with pytest.raises(MapError, match="DYNREG_MAX_PATTERN_SECONDS"):
        search("(?:a+)+(x)$", "a" * 60)


def test_a_map_is_a_file_no_larger_and_no_deeper_than_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MapError, match="too deep"):
        parse_map("a = " + "[" * 100_000)
    (tmp_path / "map.toml").write_text("# " + "x" * 1000)
    monkeypatch.setenv("DYNREG_MAX_TOML_BYTES", "1000")
    with pytest.raises(MapError, match="DYNREG_MAX_TOML_BYTES"):
        read_map(tmp_path / "map.toml")
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(MapError, match="is no file"):
        read_map(tmp_path / "pipe.toml")


def test_the_page_of_logs_states_every_limit_of_logs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
    stated = re.findall(r"\| ([\d,]+) \| .* \| `(DYNREG_MAX_\w+)` \|", page)
    told = {name: int(number.replace(",", "")) for number, name in stated}
    assert len(told) >= 13
    for limit in fields(Limits):
        assert told.pop(variable(limit.name), limit.default) == limit.default
    assert told == {}


def test_a_map_reads_only_what_it_asks_for() -> None:
    options = ReadOptions(sources=("w",))
    assert set(read_log(CSV, options).sources) == {"w"} == set(read_log(table(q=T, w=T), options).sources)
    log = read_log(numbers(3), ReadOptions(sources=("/t.w",)))
    assert set(log.sources) == {"/t.w"} and set(log.names) == {"/t.q", "/t.w"}

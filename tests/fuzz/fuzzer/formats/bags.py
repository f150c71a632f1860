"""rosbag2 .db3 files, ROS 1 bags, and the metadata.yaml of a rosbag2 folder."""

import bz2
import random
import sqlite3
from contextlib import suppress
from functools import cache

from dynreg.data.readers import read_log
from fuzzer.faulty import Faulty, rate_of
from fuzzer.formats import mcap, ros
from fuzzer.formats.logs import options_for, read_and_use, use
from fuzzer.formats.topic import Topic
from fuzzer.mutate import ODD_WHOLE, lines, odd, raw, text
from fuzzer.scratch import held
from fuzzer.target import Target

_TABLES = (
    "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)",
    "CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL)",
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
    "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL)",
    "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL, "
    "encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
    "data BLOB NOT NULL)",
)
_METADATA = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: {storage}
  duration:
    nanoseconds: 10000000
  starting_time:
    nanoseconds_since_epoch: 1700000000123456789
  message_count: 3
  topics_with_message_count:
    - topic_metadata:
        name: /a
        type: pkg/msg/T
        serialization_format: cdr
        offered_qos_profiles: []
        type_description_hash: ""
      message_count: 3
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - run{suffix}
  files:
    - path: run{suffix}
      starting_time:
        nanoseconds_since_epoch: 1700000000123456789
      duration:
        nanoseconds: 10000000
      message_count: 3
  custom_data: ~
  ros_distro: humble
"""
_WORDS = (
    "&a [x]", "*a", "<<: *a", "!!python/object:os.system", "!!binary AA==", "~", "[]", "{}", "- ", ":", "1e999",
    "0x7f", ".inf", "2001-01-01", "? ", "|", ">", "%YAML 1.1", "---", "...", "'", '"', "run.mcap",
    "../run.mcap", "/etc/passwd", "zstd", "file", "sqlite3", "mcap", "&b {x: *b}", "12345678901234567890123",
)  # fmt: skip


def make_db3(rng: random.Random) -> bytes:
    """A .db3 whose rows, tables or bytes are wrong."""
    topic = ros.msg2_topic(rng) if rng.random() < 0.8 else ros.idl_topic(rng)
    base = sqlite3.connect(":memory:")
    for statement in _TABLES:
        if rng.random() < 0.03:
            statement = statement.replace(rng.choice(("TEXT", "INTEGER", "BLOB", "NOT NULL")), "", 1)
        if rng.random() < 0.97:
            base.execute(statement)
    rows = _rows(rng, topic)
    for table, values in rows:
        try:
            base.execute(f"INSERT INTO {table} VALUES ({','.join('?' * len(values))})", values)
        except (sqlite3.Error, OverflowError, UnicodeEncodeError):
            continue  # a table that was left out, a value that no column takes
    if rng.random() < 0.05:
        name, *_ = rng.choice([row for row in rows if row[0] in ("messages", "topics")])
        with suppress(sqlite3.Error):  # left out above
            base.executescript(
                f"ALTER TABLE {name} RENAME TO hidden; CREATE VIEW {name} AS SELECT * FROM hidden;"
            )
    data = base.serialize()
    base.close()
    return raw(rng, data) if rng.random() < 0.2 else data


def _rows(rng: random.Random, topic: Topic) -> list[tuple[str, list]]:
    definition = topic.schema.decode("utf-8", "replace")
    rows: list[tuple[str, list]] = [
        ("schema", [rng.choice((4, 4, 4, 3, 1)), "humble"]),
        ("metadata", [1, 9, _METADATA.format(storage="sqlite3", suffix=".db3")]),
        ("topics", [1, "/a", topic.schema_name, "cdr", "", ""]),
        ("message_definitions", [1, topic.schema_name, topic.schema_encoding, definition, ""]),
    ]
    rows += [("messages", [k + 1, 1, mcap.START + k * 10**6, data]) for k, data in enumerate(topic.messages)]
    for _ in range(rng.choice((0, 0, 1, 2))):
        row = rng.choice(rows)[1]
        at = rng.randrange(len(row))
        row[at] = _cell(rng, row[at])
    return rows


def _cell(rng: random.Random, value: object) -> object:
    if isinstance(value, str) and rng.random() < 0.5:
        return text(rng, value)
    return rng.choice((None, 1.5, "x", b"\0" * 9, -(2**63), 2**63 - 1, 0, 10**18, value))


def make_bag1(rng: random.Random) -> bytes:
    """A ROS 1 bag with one chunk and its index, of which fields or bytes are wrong."""
    data = encode_bag1(
        Faulty(rng, rate_of(rng)), ros.msg1_topic(rng), rng.choice(("none", "none", "bz2", "lz4"))
    )
    return raw(rng, data) if rng.random() < 0.2 else data


def encode_bag1(to: Faulty, topic: Topic, compression: str = "none", packed: bytes | None = None) -> bytes:
    """The topic as a bag of version 2.0; `packed` in place of its chunk's own data."""
    about = {
        "topic": b"/a",
        "type": topic.schema_name.encode(),
        "md5sum": ros.digest(topic.schema.decode()),
        "message_definition": topic.schema,
    }
    connection = _bag_record(
        to, {"op": b"\x07", "conn": to.whole("I", 0), "topic": b"/a"}, _fields(to, about)
    )
    inner, index = connection, b""
    for k, message in enumerate(topic.messages):
        stamp = to.whole("I", 1700000000) + to.whole("I", k * 10**6)
        index += stamp + to.whole("I", len(inner))
        inner += _bag_record(to, {"op": b"\x02", "conn": to.whole("I", 0), "time": stamp}, message)
    if packed is None:
        packed = bz2.compress(inner, 1) if compression == "bz2" else mcap.pack(inner, compression)
    head = {"op": b"\x05", "compression": compression.encode(), "size": to.whole("I", len(inner))}
    chunk = _bag_record(to, head, packed)
    counted = {
        "op": b"\x04",
        "ver": to.whole("I", 1),
        "conn": to.whole("I", 0),
        "count": to.whole("I", len(topic.messages)),
    }
    body = chunk + _bag_record(to, counted, index)
    begin = len(b"#ROSBAG V2.0\n") + 4096
    place = {"op": b"\x03", "index_pos": to.whole("Q", begin + len(body)), "conn_count": to.whole("I", 1)}
    place["chunk_count"] = to.whole("I", 1)
    fields = _fields(to, place)
    padding = 4096 - 8 - len(fields)
    first = to.block("I", fields) + to.block("I", b" " * max(padding, 0))
    span = to.whole("I", 1700000000) + to.whole("I", 0)
    told = {
        "op": b"\x06",
        "ver": to.whole("I", 1),
        "chunk_pos": to.whole("Q", begin),
        "start_time": span,
        "end_time": span,
    }
    told["count"] = to.whole("I", 1)
    summary = _bag_record(to, told, to.whole("I", 0) + to.whole("I", len(topic.messages)))
    return b"#ROSBAG V2.0\n" + first + body + connection + summary


def _bag_record(to: Faulty, header: dict[str, bytes], data: bytes) -> bytes:
    return to.block("I", _fields(to, header)) + to.block("I", data)


def _fields(to: Faulty, header: dict[str, bytes]) -> bytes:
    pairs = list(header.items())
    if to.slips():
        to.rng.shuffle(pairs)
    return b"".join(to.block("I", name.encode() + b"=" + value) for name, value in pairs if not to.slips(0.3))


def make_metadata(rng: random.Random) -> bytes:
    """A metadata.yaml with lines changed or another value in place of one."""
    storage = rng.choice(("mcap", "mcap", "sqlite3"))
    document = _METADATA.format(storage=storage, suffix=".mcap" if storage == "mcap" else ".db3")
    if rng.random() < 0.3:
        rows = document.split("\n")
        at = rng.randrange(len(rows))
        rows[at] = rows[at].split(":")[0] + f": {rng.choice((odd(rng), rng.choice(ODD_WHOLE)))}"[:2000]
        document = "\n".join(rows)
    return lines(rng, document, _WORDS).encode("utf-8", "surrogatepass")


def check_metadata(data: bytes) -> None:
    """Read a rosbag2 folder whose files are sound, but for its metadata."""
    for name, content in sound_files().items():
        if not held(f"bag/{name}", None).exists():
            held(f"bag/{name}", content)
    use(read_log(held("bag/metadata.yaml", data).parent, options_for(data, True)), data)


@cache
def sound_files() -> dict[str, bytes]:
    """The same three messages as a .db3 and as an MCAP."""
    rng = random.Random(0)
    topic = ros.sound_topic()
    base = sqlite3.connect(":memory:")
    for statement in _TABLES:
        base.execute(statement)
    for table, values in _rows(random.Random(1), topic):
        base.execute(f"INSERT INTO {table} VALUES ({','.join('?' * len(values))})", values)
    base.commit()
    return {"run.db3": base.serialize(), "run.mcap": mcap.encode(Faulty(rng, 0.0), [topic], "zstd", True)}


TARGETS = (
    Target("db3", make_db3, lambda data: read_and_use(data, "run.db3")),
    Target("bag", make_bag1, lambda data: read_and_use(data, "run.bag")),
    Target("rosbag2-metadata", make_metadata, check_metadata),
)

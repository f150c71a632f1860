"""MCAP: records, chunks, schemas of every encoding, messages; the index and the summary behind them."""

import json
import random
import struct
import zlib

from fuzzer.faulty import Faulty, rate_of
from fuzzer.formats import ros
from fuzzer.formats.logs import read_and_use
from fuzzer.formats.protobuf import protobuf_topic
from fuzzer.formats.topic import Topic
from fuzzer.mutate import ODD_TEXT, raw, text, tree
from fuzzer.target import Target

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000_123_456_789  # [ns]
_MESSAGE = {
    "header": {"stamp": {"sec": 1700000000, "nanosec": 5}, "frame_id": "base"},
    "name": ["elbow", "wrist"],
    "position": [0.5, 1.5],
    "velocity": [1, 2],
    "x": 1.25,
    "on": True,
    "deep": {"a": {"b": [1.0, [2.0]]}},
}


def make(rng: random.Random) -> bytes:
    """A file of one to three topics, of which fields, messages or bytes are wrong."""
    topics = [_topic(rng, i) for i in range(rng.choice((1, 1, 2, 3)))]
    data = encode(Faulty(rng, rate_of(rng)), topics, rng.choice(("", "", "zstd", "lz4")))
    return raw(rng, data) if rng.random() < 0.2 else data


def _topic(rng: random.Random, number: int) -> Topic:
    kind = rng.choice((json_topic, json_topic, protobuf_topic, ros.idl_topic, ros.msg2_topic, ros.msg1_topic))
    topic = kind(rng)
    name = rng.choice(ODD_TEXT) if rng.random() < 0.05 else f"/{'abc'[number]}"
    return topic.named(name)


def json_topic(rng: random.Random) -> Topic:
    """JSON objects like a JointState, some of them changed."""
    messages = []
    for k in range(rng.choice((1, 3, 5))):
        message = _MESSAGE | {"x": k / 4, "header": {"stamp": {"sec": 1700000000, "nanosec": k * 1000}}}
        if rng.random() < 0.6:
            message = tree(rng, message)
        line = json.dumps(message)
        messages.append((text(rng, line) if rng.random() < 0.05 else line).encode("utf-8", "surrogatepass"))
    return Topic("/a", "thing", "jsonschema", b"{}", "json", tuple(messages))


def encode(to: Faulty, topics: list[Topic], compression: str = "", chunked: bool | None = None) -> bytes:
    """The topics as a file, in one chunk or in records alone."""
    head = MAGIC + _record(to, 1, to.text("ros2") + to.text("fuzz"))
    inner, count = _declared(to, topics), 0
    for k in range(max(len(topic.messages) for topic in topics)):
        for number, topic in enumerate(topics, start=1):
            if k < len(topic.messages):
                count += 1
                stamp = START + k * 5_000_000
                body = to.whole("H", number) + to.whole("I", k) + to.whole("Q", stamp) + to.whole("Q", stamp)
                inner += _record(to, 5, body + topic.messages[k])
    chunked = to.rng.random() < 0.6 if chunked is None else chunked
    data = head + (_chunk(to, inner, compression) if chunked else inner)
    data += _record(to, 15, to.whole("I", 0))
    return data + (_summary(to, topics, count, len(data)) if to.rng.random() < 0.7 else b"")


def _declared(to: Faulty, topics: list[Topic]) -> bytes:
    out = b""
    for number, topic in enumerate(topics, start=1):
        schema = to.text(topic.schema_name) + to.text(topic.schema_encoding) + to.block("I", topic.schema)
        out += _record(to, 3, to.whole("H", number) + schema)
        channel = to.text(topic.topic) + to.text(topic.encoding) + to.whole("I", 0)
        out += _record(to, 4, to.whole("H", number) + to.whole("H", number) + channel)
    return out


def _record(to: Faulty, opcode: int, body: bytes) -> bytes:
    if to.slips(0.2):
        body = raw(to.rng, body, 1)
    out = (
        to.whole("B", opcode) + to.block("Q", body)
        if to.slips(0.2)
        else struct.pack("<BQ", opcode, len(body)) + body
    )
    return out * to.rng.choice((0, 2, 3)) if to.slips(0.2) else out


def _chunk(to: Faulty, inner: bytes, compression: str) -> bytes:
    packed = pack(inner, compression)
    span = to.whole("Q", 0) + to.whole("Q", START * 2)
    sizes = to.whole("Q", len(inner)) + to.whole("I", zlib.crc32(inner))
    return _record(to, 6, span + sizes + to.text(compression) + to.block("Q", packed))


def pack(data: bytes, compression: str) -> bytes:
    """Data as a chunk holds it."""
    if compression == "zstd":
        import zstandard

        return zstandard.compress(data)
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.compress(data)
    return data


def _summary(to: Faulty, topics: list[Topic], count: int, start: int) -> bytes:
    counts = b"".join(to.whole("H", i + 1) + to.whole("Q", len(t.messages)) for i, t in enumerate(topics))
    told = to.whole("Q", count) + to.whole("H", len(topics)) + to.whole("I", len(topics))
    told += (
        to.whole("I", 0) + to.whole("I", 0) + to.whole("I", 1) + to.whole("Q", START) + to.whole("Q", START)
    )
    told = _declared(to, topics) + _record(to, 11, told + to.block("I", counts))
    return told + _record(to, 2, to.whole("Q", start) + to.whole("Q", 0) + to.whole("I", 0)) + MAGIC


TARGETS = (Target("mcap", make, lambda data: read_and_use(data, "run.mcap")),)

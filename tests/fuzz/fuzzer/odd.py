"""Odd logs, maps and models by code: what the table of known inputs is made of."""

import json
import random
import struct
from collections.abc import Callable

import numpy as np
import pyarrow as pa

from dynreg.registry.codec import encode_arrays
from fuzzer.faulty import Faulty
from fuzzer.formats import mcap, protobuf, robots, small, tables
from fuzzer.formats.topic import Topic


def json_log(*messages: object) -> bytes:
    """An MCAP of JSON messages: objects, or bytes as they are."""
    lines = tuple(m if isinstance(m, bytes) else json.dumps(m).encode() for m in messages)
    return log(Topic("/a", "thing", "jsonschema", b"{}", "json", lines))


def log(*topics: Topic) -> bytes:
    """An MCAP of these topics."""
    return mcap.encode(Faulty(random.Random(0), 0.0), list(topics), "", True)


def joints(**changed: object) -> dict:
    """A JointState, changed."""
    return {"name": ["elbow", "wrist"], "position": [0.5, 1.5], "x": 1.0} | changed


def nested_arrays(encoding: str) -> bytes:
    """Ten types that each hold an array of the next: few bytes of text, 4096 ** 10 items."""
    width = 4096
    parts = [f"pkg/A0[{width}] a\n"]
    parts += ["=" * 80 + f"\nMSG: pkg/A{k}\npkg/A{k + 1}[{width}] a\n" for k in range(10)]
    parts.append("=" * 80 + "\nMSG: pkg/A10\nuint8 x\n")
    cdr = encoding == "ros2msg"
    name = "pkg/msg/T" if cdr else "pkg/T"
    return log(
        Topic("/a", name, encoding, "".join(parts).encode(), "cdr" if cdr else "ros1", (bytes(64),) * 3)
    )


def recursive_protobuf(fields: int) -> bytes:
    """A type with fields of its own type."""
    from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

    file = FileDescriptorProto(name="r.proto", package="fuzz", syntax="proto3")
    kind = file.message_type.add(name="T0")
    for number in range(1, fields + 1):
        kind.field.add(name=f"f{number}", number=number, label=1, type=11, type_name=".fuzz.T0")
    schema = FileDescriptorSet(file=[file]).SerializeToString()
    inner = b""
    for _ in range(20):
        inner = b"\x0a" + protobuf.varint(len(inner)) + inner
    return log(Topic("/a", "fuzz.T0", "protobuf", schema, "protobuf", (inner, b"")))


def parquet(columns: dict, metadata: dict | None = None, unit: bytes | None = None) -> bytes:
    """A table with metadata."""
    table = pa.table(columns)
    if unit is not None:
        fields = [field.with_metadata({b"unit": unit}) for field in table.schema]
        table = table.cast(pa.schema(fields))
    return tables.written(table.replace_schema_metadata(metadata))


def about(document: object) -> Callable[[], bytes]:
    """A table whose metadata holds this document as that of a recording."""
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    return lambda: parquet({"time": [0.0, 0.25, 0.5], "q": [1.0, 2.0, 3.0]}, {b"dynreg": text})


def names(names: object) -> Callable[[], bytes]:
    """An info.json of features with these names."""
    return lambda: json.dumps({"features": {"observation.state": {"names": names}, "action": names}}).encode()


def csv(*rows: str) -> Callable[[], bytes]:
    """A CSV of these lines."""
    return lambda: ("\n".join(rows) + "\n").encode()


def changed_map(old: str, new: str) -> Callable[[], bytes]:
    """A map with a part exchanged."""
    return lambda: robots.MAP.replace(old, new).encode()


def model(inside: str, at: str = "</worldbody>") -> Callable[[], bytes]:
    """A model with an element put in."""
    return lambda: robots.text_of("model.xml").replace(at, inside + at, 1).encode()


def toml(old: str, new: str) -> Callable[[], bytes]:
    """A robot.toml with a part exchanged."""
    return lambda: robots.text_of("robot.toml").replace(old, new, 1).encode()


def ros1() -> Topic:
    """Three messages of ROS 1."""
    return Topic(
        "/a", "pkg/T", "ros1msg", b"float64 x\n", "ros1", tuple(struct.pack("<d", k) for k in range(3))
    )


def page(removed: dict | None = None, name: str = "", **changed: object) -> bytes:
    """A page that follows those of the small registry's ledger: rows that go, a name of a recording that comes."""
    number, told = small.last_page()
    names = {"recording_names": {"columns": ["name", "recording_id"], "rows": [[name, "ab"]]}}
    rows = {"number": number + 1, "removed": removed or {}, "put": names if name else {}}
    return json.dumps(told | rows | changed).encode()


def shard_of(**arrays: np.ndarray) -> bytes:
    """The small registry's shard, the arrays of which are these."""
    name = next(
        name for name, _ in small.files() if name.startswith("shards/") and name.endswith(".safetensors")
    )
    header = {"population": small.POPULATION, "start": 0, "stop": 2}
    return name.encode() + b"\n" + encode_arrays(arrays, header)

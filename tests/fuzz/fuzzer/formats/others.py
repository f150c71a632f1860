"""MATLAB files, bench logs of Rhoban/bam in JSON, and LeRobot folders."""

import io
import json
import random
import struct
import zlib
from functools import cache

import pyarrow as pa
import pyarrow.parquet as pq

from dynreg.data.readers import read_log
from fuzzer.faulty import Faulty, rate_of
from fuzzer.formats.logs import options_for, read_and_use, use
from fuzzer.formats.tables import changed, odd_table
from fuzzer.mutate import ODD_TEXT, WHOLE, nested, raw, text, tree
from fuzzer.scratch import held
from fuzzer.target import Target

_KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 9, "i8": 12, "u8": 13}
_FORMS = {
    "i1": "b",
    "u1": "B",
    "i2": "h",
    "u2": "H",
    "i4": "i",
    "u4": "I",
    "f4": "f",
    "f8": "d",
    "i8": "q",
    "u8": "Q",
}
_BENCH = {
    "kp": 32,
    "mass": 0.5,
    "motor": "mx106",
    "entries": [
        {"timestamp": 0.01 * k, "position": 0.1 * k, "load": 4 + k, "goal": 0.2 * k, "on": True}
        for k in range(5)
    ],
}
_INFO = {
    "codebase_version": "v3.0",
    "fps": 30,
    "robot_type": "so101",
    "features": {
        "observation.state": {"dtype": "float32", "shape": [2], "names": ["elbow.pos", "wrist.pos"]},
        "action": {"dtype": "float32", "shape": [2], "names": {"motors": ["elbow", "wrist"]}},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    },
}


def make_mat(rng: random.Random) -> bytes:
    """A .mat file of a few matrices, of which fields or bytes are wrong."""
    order = rng.choice("<<<>")
    to = Faulty(rng, rate_of(rng), order)
    head = (
        b"MATLAB 5.0 MAT-file".ljust(124)
        + struct.pack(f"{order}H", 0x0100)
        + (b"IM" if order == "<" else b"MI")
    )
    rows = rng.choice((1, 3, 5, 5, 5))
    body = matrix(to, "time", [k / 4 for k in range(rows)], "f8")
    for k in range(rng.choice((0, 1, 2, 3))):
        name = rng.choice(("q", "w", "kp", "t", rng.choice(ODD_TEXT)))
        form = rng.choice(tuple(_FORMS))
        values = [k] if rng.random() < 0.3 else list(range(rows))
        body += matrix(to, name, values, form)
    data = head + body
    return raw(rng, data) if rng.random() < 0.2 else data


def matrix(to: Faulty, name: str, values: list, form: str) -> bytes:
    """One matrix, compressed or not."""
    flags = to.whole("I", 6) + to.whole("I", 0)
    shape = [1, len(values)] if to.rng.random() < 0.5 else [len(values), 1]
    sizes = to.whole("I", shape[0]) + to.whole("I", shape[1])
    if to.slips():
        sizes += to.whole("I", to.rng.choice(WHOLE))
    numbers = struct.pack(f"{to.order}{len(values)}{_FORMS[form]}", *values)
    title = name.encode("utf-8", "replace")
    parts = element(to, 6, flags) + element(to, 5, sizes) + element(to, 1, title)
    whole = element(to, 14, parts + element(to, _KINDS[form], numbers))
    if to.rng.random() < 0.5:
        return whole
    packed = zlib.compress(whole)
    if to.slips():
        packed = raw(to.rng, packed)
    return to.whole("I", 15) + to.whole("I", len(packed)) + packed


def element(to: Faulty, kind: int, data: bytes) -> bytes:
    """A data element of level 5, padded to eight bytes; small ones in the small format."""
    if 0 < len(data) <= 4 and to.rng.random() < 0.5:
        return to.whole("I", len(data) << 16 | kind) + data.ljust(4, b"\0")
    return to.whole("I", kind) + to.whole("I", len(data)) + data + bytes(-len(data) % 8)


def make_json(rng: random.Random, document: object = _BENCH) -> bytes:
    """JSON with nodes of its tree changed, or its text."""
    act = rng.randrange(20)
    if act == 0:
        return (b"[" if rng.random() < 0.5 else b'{"entries":') * rng.choice((100, 2000, 100_000))
    if act == 1:
        line = json.dumps(document).replace(
            "0.1", rng.choice(("1e400", "-1e400", "NaN", "Infinity", "1" * 5000)), 1
        )
        return line.encode()
    line = json.dumps(tree(rng, document), ensure_ascii=rng.random() < 0.5)
    if act < 6:
        line = text(rng, line)
    data = line.encode("utf-8", "surrogatepass")
    return raw(rng, data) if act == 6 else data


def make_info(rng: random.Random) -> bytes:
    """meta/info.json of a LeRobot folder."""
    if rng.random() < 0.1:
        names = rng.choice(
            (nested(60, "list"), [[1, 2], [3]], [["a"], "b"], {"a": {"b": ["c"]}}, [None], [{}])
        )
        return json.dumps({"features": {"observation.state": {"names": names}}}).encode()
    return make_json(rng, _INFO)


def make_frames(rng: random.Random) -> bytes:
    """One of the Parquet files of a LeRobot folder."""
    return changed(rng, _frames()) if rng.random() < 0.5 else odd_table(rng)


def check_info(data: bytes) -> None:
    """Read a LeRobot folder of sound frames."""
    if not held("lerobot/data/chunk-000/file-000.parquet", None).exists():
        held("lerobot/data/chunk-000/file-000.parquet", _frames())
    held("lerobot/meta/info.json", data)
    use(read_log(held("lerobot", None), options_for(data, False)), data)


def check_frames(data: bytes) -> None:
    """Read a LeRobot folder of which one file of frames was changed."""
    if not held("frames/meta/info.json", None).exists():
        held("frames/meta/info.json", json.dumps(_INFO).encode())
        held("frames/data/chunk-000/file-000.parquet", _frames())
    held("frames/data/chunk-000/file-001.parquet", data)
    use(read_log(held("frames", None), options_for(data, False)), data)


@cache
def _frames() -> bytes:
    out = io.BytesIO()
    pairs = pa.array([[0.5, 1.0]] * 4, pa.list_(pa.float32(), 2))
    columns = {"observation.state": pairs, "action": pairs, "timestamp": [0.0, 0.25, 0.5, 0.75]}
    pq.write_table(pa.table(columns | {"episode_index": [0, 0, 1, 1]}), out)
    return out.getvalue()


TARGETS = (
    Target("mat", make_mat, lambda data: read_and_use(data, "run.mat")),
    Target("bam", make_json, lambda data: read_and_use(data, "run.json")),
    Target("lerobot-info", make_info, check_info),
    Target("lerobot-frames", make_frames, check_frames),
)

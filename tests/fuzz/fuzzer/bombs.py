"""Small inputs that grow large when they are read, made without being large here either."""

import bz2
import io
import random
import sqlite3
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fuzzer.faulty import Faulty
from fuzzer.formats import bags, mcap, others, thrift
from fuzzer.formats.topic import Topic

_NUM_ROWS, _ROW_GROUPS = 3, 4  # fields of Parquet's FileMetaData
_SOUND = Faulty(random.Random(0), 0.0)


def deflated(head: bytes, megabytes: int) -> bytes:
    """A zlib stream of `head` and then so many megabytes of zeros."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    begin = pack.compress(head) + pack.flush(zlib.Z_FULL_FLUSH)
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = pack.compress(bytes(2**20)) + pack.flush(
        zlib.Z_FULL_FLUSH
    )  # the same each time, so it may be repeated
    sums = zlib.adler32(head)
    low, high = sums & 0xFFFF, (sums >> 16) + megabytes * 2**20 * (sums & 0xFFFF)
    end = b"\x03\x00" + ((high % 65521) << 16 | low).to_bytes(4, "big")
    return b"\x78\xda" + begin + block * megabytes + end


def mat(variables: int, megabytes: int) -> bytes:
    """A .mat of some matrices, each of which unpacks to so many megabytes of zeros."""
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    out = head + others.matrix(_SOUND, "time", [0.0, 0.25, 0.5], "f8")
    rows = megabytes * 2**20 // 8
    for k in range(variables):
        parts = others.element(_SOUND, 6, struct.pack("<II", 6, 0)) + others.element(
            _SOUND, 5, struct.pack("<ii", 1, rows)
        )
        parts += others.element(_SOUND, 1, f"v{k}".encode())
        whole = struct.pack("<II", 14, len(parts) + 8 + rows * 8) + parts + struct.pack("<II", 9, rows * 8)
        packed = deflated(whole, megabytes)
        out += struct.pack("<II", 15, len(packed)) + packed
    return out


def zstd_chunks(chunks: int, size: int) -> bytes:
    """An MCAP of chunks that each hold one JSON message of `size` bytes, mostly zeros."""
    import zstandard

    topic = Topic("/a", "thing", "jsonschema", b"{}", "json", (b"{}",))
    data = mcap.encode(_SOUND, [topic], "", False)
    end = data.index(b"\x0f" + (4).to_bytes(8, "little"))
    message = struct.pack("<BQ", 5, 22 + size) + struct.pack("<HIQQ", 1, 0, mcap.START, mcap.START)
    pack = zstandard.ZstdCompressor(level=1).compressobj()
    packed = (
        pack.compress(message)
        + b"".join(pack.compress(bytes(2**20)) for _ in range(size // 2**20))
        + pack.flush()
    )
    head = struct.pack("<QQQI", 0, 2**63, len(message) + size, 0) + struct.pack("<I", 4) + b"zstd"
    chunk = (
        struct.pack("<BQ", 6, len(head) + 8 + len(packed)) + head + struct.pack("<Q", len(packed)) + packed
    )
    return data[:end] + chunk * chunks + data[end:]


def parquet(groups: int, rows: int, columns: int, told: int | None = None) -> bytes:
    """A table whose row groups all lie in the same bytes; every column holds one number over and over.

    told : how many rows its footer tells of; as many as there are where it is None.
    """
    names = ["time", *(f"c{i}" for i in range(columns - 1))]
    part = pa.table({name: pa.array([0.5]).take(pa.array(np.zeros(rows, np.int8))) for name in names})
    out = io.BytesIO()
    pq.write_table(part, out, compression="zstd", row_group_size=rows)

    def change(footer: list) -> None:
        for field in footer:
            if field[0] == _NUM_ROWS:
                field[2] = rows * groups if told is None else told
            elif field[0] == _ROW_GROUPS:
                field[2][1] *= groups

    return _with_footer(out.getvalue(), change)


def contradiction() -> bytes:
    """A table of lists whose footer counts one level too many of them."""
    out = io.BytesIO()
    pq.write_table(pa.table({"time": [0.0, 0.25], "q": [[1.0], [2.0]]}), out, compression="none")

    def change(footer: list) -> None:
        for group in _field(footer, _ROW_GROUPS)[1]:
            meta = _field(_field(group, 1)[1][1], 3)  # of the second column chunk
            levels = _field(_field(meta, 16), 3)[1]  # its size statistics' definition levels
            levels.append(levels[-1])

    return _with_footer(out.getvalue(), change)


def _with_footer(data: bytes, change: Callable[[list], None]) -> bytes:
    (length,) = struct.unpack("<I", data[-8:-4])
    footer, _ = thrift.decode(data[-8 - length : -8])
    change(footer)
    packed = thrift.encode(footer)
    return data[: -8 - length] + packed + struct.pack("<I", len(packed)) + b"PAR1"


def _field(struct_: list, number: int) -> Any:
    return next(value for at, _, value in struct_ if at == number)


def bag(megabytes: int) -> bytes:
    """A ROS 1 bag whose one chunk unpacks to so many megabytes of zeros."""
    block = bz2.compress(bytes(8 * 2**20))  # streams may follow each other
    topic = Topic("/a", "pkg/T", "ros1msg", b"float64 x\n", "ros1", (struct.pack("<d", 1.0),))
    return bags.encode_bag1(_SOUND, topic, "bz2", block * (megabytes // 8))


def endless_db3() -> bytes:
    """A .db3 whose messages are a view that never ends."""
    base = sqlite3.connect(":memory:")
    base.deserialize(bags.sound_files()["run.db3"])
    base.executescript(
        "ALTER TABLE messages RENAME TO kept; CREATE VIEW messages AS WITH RECURSIVE n(i) AS "
        "(SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id, i AS timestamp, data FROM n, kept;"
    )
    return base.serialize()

"""CSV and Parquet: text changed line by line; well-formed files of odd types and metadata; footers and pages."""

import io
import json
import random
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fuzzer.formats import thrift
from fuzzer.formats.logs import read_and_use
from fuzzer.mutate import ODD_REAL, ODD_TEXT, lines, odd, raw, tree
from fuzzer.target import Target

_CSV = "time,arm/position,arm/velocity,arm/target,episode\n" + "".join(
    f"{0.01 * i:.2f},{0.1 * i:.3f},{0.2 * i},{i},e{i // 4}\n" for i in range(8)
)
_CELLS = (
    *ODD_TEXT,
    "1e400",
    "1700000000000000000",
    "9223372036854775808",
    "-0",
    "1,2",
    '"',
    '"a\nb"',
    ";",
    "\t",
    "2026-01-01",
    "12:00",
)
_CELLS += ("2026-01-01 00:00:00.5", "TRUE", "1.", ".5", "0b1", "∞", "1 2", "'")


def make_csv(rng: random.Random) -> bytes:
    """A CSV of eight rows: cells, lines, delimiters, encodings changed."""
    document = _CSV
    if rng.random() < 0.15:
        document = document.replace(",", rng.choice((";", "\t", "|", " ", ",,")))
    if rng.random() < 0.3:
        document = _stamped(rng)
    if rng.random() < 0.9:
        document = _cells(rng, document) if rng.random() < 0.6 else lines(rng, document, _CELLS)
    if rng.random() < 0.1:
        document = document.replace("\n", rng.choice(("\r\n", "\r", "\n\n")))
    coding = rng.choice(("utf-8",) * 18 + ("utf-16", "utf-8-sig"))
    data = document.encode(coding, "surrogatepass")
    return raw(rng, data) if rng.random() < 0.15 else data


def _stamped(rng: random.Random) -> str:
    start = rng.choice((1_700_000_000_000_000_000, 2**63 - 3, -(2**63), 0))
    return "timestamp,q,w\n" + "".join(f"{start + k},{k},{k / 3}\n" for k in range(5))


def _cells(rng: random.Random, document: str) -> str:
    rows = [line.split(",") for line in document.split("\n")]
    for _ in range(rng.choice((1, 1, 2, 4))):
        row = rng.choice(rows)
        at = rng.randrange(len(row))
        row[at] = str(rng.choice((rng.choice(_CELLS), odd(rng, flat=True))))[:400]
    if rng.random() < 0.2:  # a whole column
        at, word = rng.randrange(5), rng.choice(_CELLS)
        for row in rows[1:]:
            if at < len(row):
                row[at] = word
    return "\n".join(",".join(row) for row in rows)


_WHEN = (0, 1, 1_700_000_000, 2**31, 2**53, 2**62, -(2**62))
_COLUMNS: dict[str, tuple[Callable[[], pa.DataType], tuple[Any, ...]]] = {
    "double": (pa.float64, (0.0, 0.5, 1.5, None, *ODD_REAL)),
    "float": (pa.float32, (0.0, 0.5, None)),
    "half": (pa.float16, (0.0, 0.5)),
    "int64": (pa.int64, (0, 1, 2, None, 2**63 - 1, -(2**63), 1_700_000_000_000_000_000)),
    "uint64": (pa.uint64, (0, 1, 2**64 - 1, None)),
    "int8": (pa.int8, (0, -128, None)),
    "bool": (pa.bool_, (True, False, None)),
    "text": (pa.string, (*(t for t in ODD_TEXT if t.isprintable()), None)),
    "large text": (pa.large_string, ("a", None)),
    "binary": (pa.binary, (b"", b"\xff", None)),
    "stamp ns": (lambda: pa.timestamp("ns"), (*_WHEN, None)),
    "stamp s": (lambda: pa.timestamp("s", "UTC"), (*_WHEN[:5], None)),
    "stamp us": (lambda: pa.timestamp("us", "Europe/Berlin"), (*_WHEN, None)),
    "duration": (lambda: pa.duration("s"), (0, 2**62, None)),
    "date": (pa.date32, (0, 20000, 2**31 - 1, None)),
    "date64": (pa.date64, (0, 86_400_000, None)),
    "clock": (lambda: pa.time64("ns"), (0, 1, None)),
    "decimal": (lambda: pa.decimal128(38, 2), (None,)),
    "null": (pa.null, (None,)),
    "list": (lambda: pa.list_(pa.float64()), ([], [1.0], [1.0, None, 3.0], None, [0.5] * 65)),
    "fixed list": (lambda: pa.list_(pa.float64(), 2), ([0.5, 1.0], None)),
    "list of text": (lambda: pa.list_(pa.string()), (["a"], None)),
    "nested list": (lambda: pa.list_(pa.list_(pa.int64())), ([[1]], [], None)),
    "struct": (lambda: pa.struct([("x", pa.float64()), ("y", pa.string())]), ({"x": 1.0, "y": "a"}, None)),
    "map": (lambda: pa.map_(pa.string(), pa.float64()), ([("a", 1.0)], None)),
    "category": (lambda: pa.dictionary(pa.int32(), pa.string()), ("a", "b", None)),
    "category of numbers": (lambda: pa.dictionary(pa.int8(), pa.float64()), (0.5, 1.5, None)),
    "text view": (pa.string_view, ("a", None)),
}
_NAMES = ("time", "timestamp", "q", "w", "episode", "t", "a[0]", "kp", "episode_index")
_ABOUT = {
    "schema": "dynreg/recording/1",
    "episodes": [{"name": "a", "rows": 4, "settings": {"kp": 1.0}}],
    "measured": True,
    "provenance": {},
}


def make_parquet(rng: random.Random) -> bytes:
    """A Parquet file: odd types and metadata, or a footer or pages that were changed."""
    if rng.random() < 0.45:
        return changed(rng, rng.choice(_sound()))
    data = odd_table(rng)
    return changed(rng, data) if rng.random() < 0.1 else data


def odd_table(rng: random.Random) -> bytes:
    """A well-formed file of columns that few logs have."""
    rows = rng.choice((0, 1, 2, 4, 4, 4))
    names = [
        rng.choice(_NAMES) if rng.random() < 0.9 else rng.choice(ODD_TEXT)
        for _ in range(rng.choice((1, 2, 3)))
    ]
    names = [
        n.encode("utf-8", "replace").decode() for n in (["time", *names] if rng.random() < 0.7 else names)
    ]
    arrays, fields = [], []
    for name in names:
        kind, values = _COLUMNS[
            rng.choice(list(_COLUMNS)) if name != "time" or rng.random() < 0.5 else "double"
        ]
        few = rng.sample(values, min(len(values), rng.choice((1, 2, 4))))
        column = (
            [rng.choice(few) for _ in range(rows)]
            if name != "time" or kind is not pa.float64
            else [k / 4 for k in range(rows)]
        )
        fields.append(pa.field(name, kind(), metadata=_unit(rng)))
        arrays.append(pa.array(column, kind()))
    about = json.dumps(tree(rng, _ABOUT)).encode("utf-8", "replace") if rng.random() < 0.5 else None
    if about is not None and rng.random() < 0.1:
        about = raw(rng, about)
    schema = pa.schema(fields, metadata={b"dynreg": about} if about is not None else None)
    try:
        return written(
            pa.Table.from_arrays(arrays, schema=schema), rng.choice(("none", "snappy", "zstd", "gzip"))
        )
    except pa.ArrowException:  # types that Parquet does not have
        return _sound()[0]


def _unit(rng: random.Random) -> dict[bytes, bytes] | None:
    if rng.random() < 0.5:
        return None
    return {
        b"unit": rng.choice(
            (b"rad", b"deg", b"", b"\xff\xfe", b"\x1b[31m", b"furlong", "µm".encode(), b"x" * 500)
        )
    }


def written(table: pa.Table, compression: str = "none") -> bytes:
    """A table as Parquet."""
    out = io.BytesIO()
    pq.write_table(table, out, compression=compression)
    return out.getvalue()


@cache
def _sound() -> tuple[bytes, ...]:
    columns = {"time": [0.0, 0.25, 0.5, 0.75], "q": [1.0, 2.0, None, 3.0], "n": ["a", "b", "a", None]}
    columns["xs"] = [[1.0, 2.0], [], None, [3.0]]
    kinds = ("none", "snappy", "zstd", "gzip", "brotli", "lz4")
    return tuple(written(pa.table(columns), kind) for kind in kinds)


def changed(rng: random.Random, data: bytes) -> bytes:
    """A file whose footer was changed field by field, or whose pages or bytes were."""
    (length,) = struct.unpack("<I", data[-8:-4])
    body, footer = data[: -8 - length], data[-8 - length : -8]
    act = rng.randrange(4)
    if act < 2:
        try:
            footer = thrift.encode(thrift.changed(rng, thrift.decode(footer)[0]))
        except (ValueError, IndexError):  # of a table that has what no footer needs, such as a map
            footer = raw(rng, footer)
    elif act == 2:
        body = b"PAR1" + raw(rng, body[4:])
    else:
        return raw(rng, data)
    return body + footer + struct.pack("<I", len(footer)) + b"PAR1"


TARGETS = (
    Target("csv", make_csv, lambda data: read_and_use(data, "run.csv")),
    Target("parquet", make_parquet, lambda data: read_and_use(data, "run.parquet")),
)

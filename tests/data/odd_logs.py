"""The table of odd but plausible logs: what is written, and what reading it gives."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import Writer
from scipy.io import savemat

from dynreg.data.readers import ReadOptions

T = np.arange(6) * 0.5
NS = 1_700_000_000_000_000_001 + 500_000_000 * np.arange(6)
BIG = "1" + "0" * 400  # a whole number beyond a double
NAN = float("nan")


@dataclass(frozen=True)
class Odd:
    """One odd log.

    write : writes it at a path. values, time : of the signal `source`, where it is read. told : what a finding says.
    refused : what the error says, where it is not read.
    """

    title: str
    name: str
    write: Callable[[Path], object]
    source: str = "q"
    values: Sequence[float] | None = None
    time: Sequence[float] = tuple(T)
    told: str | None = None
    refused: str | None = None
    options: ReadOptions = field(default_factory=ReadOptions)


def csv(**columns: Sequence[object]) -> Callable[[Path], object]:
    """A CSV file."""
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n"
    return lambda path: path.write_text(text)


def parquet(
    metadata: Mapping[bytes, bytes] | None = None, unit: bytes | None = None, **columns: Any
) -> Callable:
    """A Parquet file; `unit` is that of its last column."""
    table = pa.table({"time": T, **columns} if "time" not in columns else columns)
    last = table.schema[-1].with_metadata({b"unit": unit} if unit else None)
    table = table.cast(table.schema.set(len(columns) - ("time" in columns), last).with_metadata(metadata))
    return lambda path: pq.write_table(table, path)


def mcap(*messages: object, stamps: Sequence[int] | None = None) -> Callable[[Path], object]:
    """An MCAP file of JSON messages, or their bytes, half a second apart."""

    def write(path: Path) -> None:
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel(
                "/arm", "json", writer.register_schema("t", "jsonschema", b"{}")
            )
            for k, message in enumerate(messages):
                data = message if isinstance(message, bytes) else json.dumps(message).encode()
                writer.add_message(channel, stamps[k] if stamps else int(NS[k]), data, 0)
            writer.finish()

    return write


def joints(odd: object) -> Callable[[Path], object]:
    """A log of JointState with something else in the place of one position."""
    odd = odd if isinstance(odd, str) and odd.isdigit() else json.dumps(odd)
    text = f'{{"name": ["a", "b"], "position": [%s, {2.0}]}}'
    return mcap(*((text % (odd if k == 2 else k)).encode() for k in range(6)))


def stamped(second: str) -> Callable[[Path], object]:
    """A log whose third message has another `header.stamp.sec`."""
    text = '{"header": {"stamp": {"sec": %s, "nanosec": 0}}, "q": %d}'
    return mcap(*((text % (second if k == 2 else k + 1_700_000_000, k)).encode() for k in range(6)))


def bench(**changed: str) -> Callable[[Path], object]:
    """A bench log; `changed` gives the third entry's cells as JSON text."""
    entries = [{"timestamp": f"{t}", "q": f"{k}"} | (changed if k == 2 else {}) for k, t in enumerate(T)]
    text = ",".join("{" + ",".join(f'"{k}": {v}' for k, v in e.items()) + "}" for e in entries)
    return lambda path: path.write_text(f'{{"entries": [{text}]}}')


def lerobot(info: str) -> Callable[[Path], object]:
    """A LeRobot dataset with this text as its info.json."""

    def write(path: Path) -> None:
        (path / "meta").mkdir(parents=True)
        (path / "data").mkdir()
        (path / "meta" / "info.json").write_text(info)
        pq.write_table(
            pa.table({"timestamp": T, "q": [[k, -k] for k in range(6)]}), path / "data" / "0.parquet"
        )

    return write


def named(names: str) -> Callable[[Path], object]:
    """A LeRobot dataset with these names of its joints."""
    return lerobot(f'{{"features": {{"q": {{"names": {names}}}}}}}')


def _gap(cells: Sequence[object], row: int = 2) -> list:
    return [None if i == row else c for i, c in enumerate(cells)]


SIX = tuple(range(6))
HOLE = (0, 1, NAN, 3, 4, 5)
TIME_HOLE = tuple(_gap(T))
NANOS = ReadOptions(time_unit="ns")
FAR = [10**12 + i for i in range(6)]  # [s] after 1970, more than nanoseconds reach
LISTED = "meta/info.json does not hold names"


def _ns(cells: Sequence[object]) -> Odd:
    return csv(time=["" if c is None else c for c in cells], q=SIX)


TABLES = [
    Odd("whole nanoseconds with an empty cell", "x.csv", _ns(_gap(NS)), "q", SIX, TIME_HOLE, options=NANOS),
    Odd(
        "whole nanoseconds with an empty cell in Parquet",
        "x.parquet",
        parquet(time=pa.array([None if s is None else int(s) for s in _gap(NS)]), q=SIX),
        values=SIX,
        time=TIME_HOLE,
        options=NANOS,
    ),
    Odd(
        "whole numbers beyond 2**53 with an empty cell",
        "x.parquet",
        parquet(q=pa.array(_gap([2**62] * 6), pa.int64())),
        values=[2.0**62, 2.0**62, NAN, 2.0**62, 2.0**62, 2.0**62],
    ),
    Odd(
        "dates of nanoseconds with an empty cell",
        "x.parquet",
        parquet(time=pa.array(_gap(NS.tolist()), pa.timestamp("ns")), q=SIX),
        values=SIX,
        time=TIME_HOLE,
    ),
    Odd(
        "dates beyond nanoseconds as the time",
        "x.parquet",
        parquet(time=pa.array(FAR, pa.timestamp("s")), q=SIX),
        values=SIX,
        time=SIX,
    ),
    Odd("dates beyond nanoseconds", "x.parquet", parquet(q=pa.array(FAR, pa.timestamp("s"))), values=FAR),
    Odd("spans beyond nanoseconds", "x.parquet", parquet(q=pa.array(FAR, pa.duration("s"))), values=FAR),
    Odd(
        "dates of the year 9000 in CSV",
        "x.csv",
        csv(time=[f"9000-01-01T00:00:0{i}" for i in range(6)], q=SIX),
        values=SIX,
        time=SIX,
    ),
    Odd(
        "dates in CSV with an empty cell",
        "x.csv",
        csv(time=[f"2024-01-01T00:00:0{i}" if i != 2 else "" for i in range(6)], q=SIX),
        values=SIX,
        time=(0, 1, NAN, 3, 4, 5),
    ),
    Odd(
        "whole numbers beyond a double in CSV",
        "x.csv",
        csv(time=T, q=[0, 1, BIG, 3, 4, 5]),
        values=(0, 1, float("inf"), 3, 4, 5),
    ),
    Odd(
        "unsigned stamps of 8 bits that run back",
        "x.mat",
        lambda p: savemat(p, {"t": np.arange(6, dtype=np.uint8)[::-1].copy(), "q": np.arange(6.0)}),
        values=SIX,
        time=(0, -1, -2, -3, -4, -5),
    ),
    Odd("a unit that is not UTF-8", "x.parquet", parquet(unit=b"\xff\xfe", q=SIX), values=SIX, told="unit"),
    *(
        Odd(
            f"settings of another form: {m[:40]!r}",
            "x.parquet",
            parquet({b"dynreg": m}, q=SIX),
            values=SIX,
            told="settings",
        )
        for m in (
            b"\xff",
            b"[]",
            b'{"episodes": 3}',
            b'{"episodes": [{"rows": 1e400, "settings": {}}]}',
            b'{"episodes": [{"rows": -1, "settings": {"kp": 1}}, {"rows": 7, "settings": {"kp": 1}}]}',
            b"[" * 100_000,
        )
    ),
    Odd(
        "a setting beyond a double",
        "x.parquet",
        parquet({b"dynreg": f'{{"episodes": [{{"rows": 6, "settings": {{"kp": {BIG}}}}}]}}'.encode()}, q=SIX),
        values=SIX,
    ),
    Odd(
        "a header in Latin-1",
        "x.csv",
        lambda p: p.write_bytes(b"time,q,\xb0C\n0,0,1\n0.5,1,1\n"),
        values=(0, 1),
        time=(0, 0.5),
    ),
    Odd(
        "two columns of one name",
        "x.parquet",
        lambda p: pq.write_table(pa.Table.from_arrays([pa.array(T)] * 3, names=["time", "q", "q"]), p),
        refused="two columns named 'q'",
    ),
    Odd(
        "a time that is text",
        "x.parquet",
        parquet(time=list("abcdef"), q=SIX),
        refused="'time' does not hold numbers",
    ),
]

MESSAGES = [
    *(
        Odd(f"a joint at {str(odd)[:20]}", "x.mcap", joints(odd), "/arm.position[a]", HOLE, told="no number")
        for odd in (None, "high", {"x": 1}, [1], BIG, "1" + "0" * 5000)
    ),
    Odd(
        "joints that are nowhere",
        "x.mcap",
        mcap(*[{"name": ["a"], "position": [None]}] * 6),
        "/arm.position[a]",
        [NAN] * 6,
        told="no number",
    ),
    Odd(
        "a number beyond a double",
        "x.mcap",
        mcap(*(f'{{"q": {BIG if k == 2 else k}}}'.encode() for k in range(6))),
        "/arm.q",
        HOLE,
        told="no number",
    ),
    *(
        Odd(f"a second of {second[:20]}", "x.mcap", stamped(second), "/arm.q", SIX, told="header stamps")
        for second in (BIG, "1" + "0" * 30, "-5", '"1"')
    ),
    Odd(
        "a message of great depth",
        "x.mcap",
        mcap({"q": 0}, b'{"q": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", {"q": 2}),
        "/arm.q",
        (0, 2),
        (0, 1),
        "recursion",
    ),
    Odd(
        "stamps at either end of time",
        "x.mcap",
        mcap({"q": 0}, {"q": 1}, stamps=[0, 2**64 - 1]),
        "/arm.q",
        (0, 1),
        (0, (2**64 - 1) * 1e-9),
    ),
]

JSON = [
    Odd("an entry of null", "x.json", bench(q="null"), values=HOLE),
    Odd("an entry of text", "x.json", bench(q='"x"'), values=HOLE, told="no number"),
    Odd("an entry beyond a double", "x.json", bench(q=BIG), values=HOLE, told="no number"),
    Odd("an entry of 5,000 digits", "x.json", bench(q="1" + "0" * 5000), values=HOLE, told="no number"),
    Odd(
        "a stamp beyond a double",
        "x.json",
        bench(timestamp=BIG),
        values=SIX,
        time=TIME_HOLE,
        told="no number",
    ),
    Odd(
        "whole nanoseconds in JSON",
        "x.json",
        lambda p: p.write_text(json.dumps({"entries": [{"t": int(s), "q": k} for k, s in enumerate(NS)]})),
        values=SIX,
        options=NANOS,
    ),
]

DATASETS = [
    *(
        Odd(f"info.json of {text[:20]}", "set", lerobot(text), refused=LISTED)
        for text in ("[]", "null", "3", '{"features": [1]}')
    ),
    Odd("a deep info.json", "set", lerobot("[" * 100_000), refused="recursion"),
    Odd("no features", "set", lerobot('{"features": null}'), "q[1]", (0, -1, -2, -3, -4, -5)),
    Odd("ragged names", "set", named('[["a"], ["b", "c"]]'), "q[b]", (0, -1, -2, -3, -4, -5)),
    Odd("deep names", "set", named("[" * 900 + '"a", "b"' + "]" * 900), "q[b]", (0, -1, -2, -3, -4, -5)),
]

ALL = (*TABLES, *MESSAGES, *JSON, *DATASETS)

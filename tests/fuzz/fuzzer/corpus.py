"""Inputs that once ended in a traceback, a hang or gigabytes, each made by code; those found since lie in `corpus/`."""

import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from dynreg.registry.codec import encode_arrays
from fuzzer import bombs, odd
from fuzzer.faulty import Faulty
from fuzzer.formats import bags
from fuzzer.mutate import nested

FOLDER = Path(__file__).parents[1] / "corpus"


@dataclass(frozen=True)
class Case:
    """One input of a target."""

    title: str
    target: str
    make: Callable[[], bytes]


def cases() -> Iterator[Case]:
    """Those of the table, then the files of `corpus/TARGET/`."""
    yield from CASES
    for path in sorted(FOLDER.glob("*/*")):
        yield Case(f"{path.parent.name}: {path.stem}", path.parent.name, path.read_bytes)


_STAMPS = ["1700000000123456789,1", "1700000000223456789,2", "1700000000323456789,3", "1700000000423456789,4"]
_LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
_DEEP = b"[" * 100_000

CASES: tuple[Case, ...] = (
    Case(
        "nanosecond stamps with an empty cell",
        "csv",
        odd.csv("timestamp,q", *_STAMPS[:2], ",5", *_STAMPS[2:]),
    ),
    Case(
        "nanosecond stamps with an empty value",
        "csv",
        odd.csv("timestamp,q", *_STAMPS, "1700000000523456789,"),
    ),
    Case(
        "nanosecond stamps with a null, Parquet",
        "parquet",
        lambda: odd.parquet(
            {"timestamp": [1_700_000_000_000_000_000, None, 1_700_000_000_500_000_000], "q": [1.0, 2.0, 3.0]}
        ),
    ),
    Case(
        "dates before the nanosecond range",
        "csv",
        odd.csv("time,q", "0001-01-01 00:00:00,1", "0001-01-01 00:00:01,2"),
    ),
    Case("dates after the nanosecond range", "csv", odd.csv("time,q", "9999-12-30,1", "9999-12-31,2")),
    Case(
        "seconds after the nanosecond range, Parquet",
        "parquet",
        lambda: odd.parquet({"time": pa.array([2**40, 2**40 + 1], pa.timestamp("s")), "q": [1.0, 2.0]}),
    ),
    Case(
        "a duration beyond nanoseconds",
        "parquet",
        lambda: odd.parquet({"time": pa.array([0, 2**62], pa.duration("s"))}),
    ),
    Case("a whole number above 1e308, CSV", "csv", odd.csv("time,q", "0,1", "1," + "9" * 400, "2,3")),
    Case(
        "a whole number above 1e308, bench log",
        "bam",
        lambda: b'{"entries": [{"timestamp": 0, "q": 1' + b"0" * 400 + b"}]}",
    ),
    Case(
        "a whole number above 1e308, JSON message",
        "mcap",
        lambda: odd.json_log(odd.joints(), odd.joints(x=10**400)),
    ),
    Case(
        "null in a JointState's position",
        "mcap",
        lambda: odd.json_log(odd.joints(), odd.joints(position=[None, 1.5])),
    ),
    Case(
        "text in a JointState's position",
        "mcap",
        lambda: odd.json_log(odd.joints(position=["a", 1.5]), odd.joints()),
    ),
    Case(
        "an object as a JointState's position",
        "mcap",
        lambda: odd.json_log(odd.joints(position=[{}, []]), odd.joints()),
    ),
    Case(
        "a stamp of 1e30 seconds",
        "mcap",
        lambda: odd.json_log(
            *(odd.joints(header={"stamp": {"sec": 10**n, "nanosec": 0}}) for n in (9, 30, 400))
        ),
    ),
    Case("settings of another form in Parquet's metadata", "parquet", odd.about({"episodes": {"rows": 3}})),
    *(
        Case(f"Parquet metadata that is {title}", "parquet", odd.about(document))
        for title, document in (
            ("a list", [1]),
            ("null", None),
            ("no JSON", b"\xff\x00"),
            ("deep", b'{"episodes": ' + _DEEP),
            ("episodes of numbers", {"episodes": [1, 2]}),
            ("rows as text", {"episodes": [{"rows": "3", "settings": {}}]}),
            ("settings as a list", {"episodes": [{"rows": 3, "settings": ["a"]}]}),
            ("settings of objects", {"episodes": [{"rows": 3, "settings": {"kp": {}}}]}),
            ("rows without end", {"episodes": [{"rows": 1e400, "settings": {}}]}),
        )
    ),
    Case(
        "a unit that is no UTF-8",
        "parquet",
        lambda: odd.parquet({"time": [0.0, 0.25, 0.5], "q": [1.0, 2.0, 3.0]}, unit=b"\xff\xfe"),
    ),
    *(
        Case(f"info.json that is {title}", "lerobot-info", lambda text=text: text)
        for title, text in (
            ("a list", b"[]"),
            ("null", b"null"),
            ("deep", _DEEP),
            ("a number", b"1"),
            ("no UTF-8", b"\xff"),
        )
    ),
    *(
        Case(f"features' names that are {title}", "lerobot-info", odd.names(names))
        for title, names in (
            ("ragged", [["a"], "b", ["c", "d"]]),
            ("deep", nested(150, "list")),
            ("null", [None, {}]),
        )
    ),
    Case("features as a list", "lerobot-info", lambda: b'{"features": [1]}'),
    Case("a recursive protobuf type", "mcap", lambda: odd.recursive_protobuf(3)),
    Case("a recursive protobuf type of 200 fields", "mcap", lambda: odd.recursive_protobuf(200)),
    Case("nested arrays, ROS 2", "mcap", lambda: odd.nested_arrays("ros2msg")),
    Case("nested arrays, ROS 1", "mcap", lambda: odd.nested_arrays("ros1msg")),
    Case("a message of JSON that is deep", "mcap", lambda: odd.json_log(_DEEP)),
    Case("a bench log that is deep", "bam", lambda: _DEEP),
    Case("a metadata.yaml that doubles", "rosbag2-metadata", lambda: _LAUGHS.encode()),
    Case(
        "a metadata.yaml that is deep",
        "rosbag2-metadata",
        lambda: b"rosbag2_bagfile_information: " + b"[" * 5000,
    ),
    Case("a .mat of five gigabytes", "mat", lambda: bombs.mat(5, 1000)),
    Case("a .mat of many variables", "mat", lambda: bombs.mat(60, 100)),
    Case("zstd chunks of a gigabyte", "mcap", lambda: bombs.zstd_chunks(3, 1000 * 2**20)),
    Case("a table of 200 million rows", "parquet", lambda: bombs.parquet(200, 10**6, 2)),
    Case("a table of 90 million rows and 20 columns", "parquet", lambda: bombs.parquet(90, 10**6, 20)),
    Case("a bag whose chunk is two gigabytes", "bag", lambda: bombs.bag(2000)),
    Case("a .db3 whose messages never end", "db3", bombs.endless_db3),
    Case(
        "a table of 50,000 episodes",
        "csv",
        lambda: b"time,q,episode\n" + b"".join(b"%d,1,e%d\n" % (k, k) for k in range(50_000)),
    ),
    Case(
        "a table of 100,000 columns",
        "csv",
        lambda: b"\n".join(
            [b"time," + b",".join(b"c%d" % k for k in range(100_000)), b"0" + b",1" * 100_000]
        ),
    ),
    Case("a pattern that runs away", "map", odd.changed_map("kp(\\d+)", "(?:a+)+(x)$")),
    Case("a pattern that runs away over digits", "map", odd.changed_map("kp(\\d+)", "(?:[a-z]*)*(\\d)$")),
    Case(
        "a clock of years at a slow filter",
        "map",
        odd.changed_map('time_unit = "s"', 'time_unit = "s"\ntime = "n"'),
    ),
    Case("a delay without end", "map", odd.changed_map("delay = 0.001", "delay = inf")),
    Case("a scale without end", "map", odd.changed_map("scale = 1.0", "scale = 1e308")),
    Case("a map that is deep", "map", lambda: b"a = " + _DEEP),
    Case("a robot.toml that is deep", "robot-toml", lambda: b"a = " + _DEEP),
    Case("a time step of 1e-12 s", "robot-toml", odd.toml("timestep = 0.0025", "timestep = 1e-12")),
    Case(
        "a height field of 10 billion cells",
        "mjcf",
        odd.model('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>', "</asset>"),
    ),
    Case(
        "a height field beside the assets",
        "mjcf",
        odd.model('<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>', "</mujoco>"),
    ),
    Case(
        "a texture of 10 billion texels",
        "mjcf",
        odd.model(
            '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
            "</mujoco>",
        ),
    ),
    Case(
        "a million copies of a body",
        "mjcf",
        odd.model('<replicate count="1000000" offset="1 0 0"><body><geom size="1"/></body></replicate>'),
    ),
    Case(
        "copies of copies",
        "mjcf",
        odd.model(
            '<replicate count="3000"><replicate count="3000"><geom size="0.1"/></replicate></replicate>'
        ),
    ),
    Case(
        "a cable of a million bodies",
        "mjcf",
        odd.model(
            '<body name="c"><composite type="cable" count="1000000 1 1" size="1" curve="s">'
            '<geom size="0.01"/></composite></body>'
        ),
    ),
    Case("a stack as large as memory", "mjcf", odd.model('<size memory="2000G"/>', "</mujoco>")),
    Case("a model that includes itself", "mjcf", odd.model('<include file="model.xml"/>')),
    Case("a file outside the folder", "mjcf", odd.model('<include file="../../../../../etc/passwd"/>')),
    Case("a model without end", "mjcf", lambda: b"<mujoco>" + b"<worldbody>" * 100_000),
    Case(
        "a page of small numbers",
        "mat",
        lambda: b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x100) + b"IM" + b"\x0f\0\0\0" + b"\xff" * 4,
    ),
    Case("a sound bag", "bag", lambda: bags.encode_bag1(Faulty(random.Random(0), 0.0), odd.ros1())),
    Case("a sound .db3", "db3", lambda: bags.sound_files()["run.db3"]),
    Case("a sound MCAP", "mcap", lambda: bags.sound_files()["run.mcap"]),
    *(
        Case(f"{title}, in a sealed catalogue", "catalog", lambda line=line: line.encode())
        for title, line in (
            ("a text for a number", "UPDATE shards SET stop = 'a'"),
            ("two thousand million entries", "UPDATE shards SET stop = 2000000000"),
            ("a manifest that is a number", "UPDATE robots SET manifest = 1"),
            ("a manifest that is no JSON", "UPDATE robots SET manifest = 'a'"),
            ("a layout that is a list", "UPDATE populations SET layout = '[]'"),
            ("a size below nothing", "UPDATE populations SET size = -1"),
            ("bytes for a name", "UPDATE robots SET name = x'ff00'"),
            (
                "a view for a table",
                "ALTER TABLE entries RENAME TO kept\nCREATE VIEW entries AS SELECT * FROM kept",
            ),
        )
    ),
    Case("a name as wide as memory", "map", odd.changed_map("{stem}_{kp}", "{stem:>10000000000}")),
    Case(
        "a bag whose fields are all its own", "bag", lambda: b"#ROSBAG V2.0\n" + struct.pack("<I", 2**32 - 1)
    ),
    Case("more rows than the footer tells of", "parquet", lambda: bombs.parquet(90, 10**6, 20, 9)),
    Case(
        "a recording of more rows than its footer tells of",
        "recording",
        lambda: bombs.parquet(90, 10**6, 20, 9),
    ),
    Case("a footer that contradicts itself", "parquet", bombs.contradiction),
    Case("a shard without losses", "registry-file", lambda: odd.shard_of(values=np.ones((2, 1)))),
    Case("a shard of one number", "registry-file", lambda: odd.shard_of(values=np.ones(()))),
    Case("rows of no table in a page", "ledger-page", lambda: odd.page(removed={"none": [["a"]]})),
    Case("a key that is a list in a page", "ledger-page", lambda: odd.page(removed={"results": [[["a"]]]})),
    Case("a page without end", "ledger-page", lambda: odd.page(number=float("inf"))),
    Case("half a surrogate pair in a page", "ledger-page", lambda: odd.page(name="\ud800")),
    Case("a header that is a list", "shard-arrays", lambda: encode_arrays({"values": np.ones(2)}, [])),
)

"""One module a log format, each with `read(path, options) -> RawLog`, and the table that picks among them."""

import importlib
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from dynreg.data.series import RawLog
from dynreg.errors import LogError

Format = Literal["mcap", "rosbag", "csv", "parquet", "matlab", "bam", "lerobot"]

# Each reader imports its libraries; they load when a log of that kind is met.
_READERS = MappingProxyType(
    {
        "mcap": "dynreg.data.readers.mcap_log",
        "rosbag": "dynreg.data.readers.rosbag",
        "csv": "dynreg.data.readers.tables",
        "parquet": "dynreg.data.readers.tables",
        "matlab": "dynreg.data.readers.matlab",
        "bam": "dynreg.data.readers.bam",
        "lerobot": "dynreg.data.readers.lerobot",
    }
)
_MAGIC: tuple[tuple[bytes, Format], ...] = (
    (b"\x89MCAP0\r\n", "mcap"),
    (b"#ROSBAG V", "rosbag"),
    (b"SQLite format 3\x00", "rosbag"),
    (b"PAR1", "parquet"),
    (b"MATLAB 5.0", "matlab"),
    (b"MATLAB 7.3", "matlab"),
    (b"\x89HDF\r\n\x1a\n", "matlab"),
)
_SUFFIXES: MappingProxyType[str, Format] = MappingProxyType(
    {
        ".mcap": "mcap",
        ".bag": "rosbag",
        ".db3": "rosbag",
        ".csv": "csv",
        ".tsv": "csv",
        ".parquet": "parquet",
        ".mat": "matlab",
        ".json": "bam",
    }
)


@dataclass(frozen=True)
class ReadOptions:
    """What the map says about reading: the column or stamp that is the clock, and its unit.

    `time` is a table's time column, or "log" for messages whose header stamps are not to be used;
    None takes the usual names and header stamps. `time_unit` is s, ms, us or ns. `sources` are the names that
    will be asked for, so that topics without any (images, scans) need not be decoded; None asks for all.
    """

    time: str | None = None
    time_unit: str = "s"
    sources: tuple[str, ...] | None = None

    def wants(self, topic: str) -> bool:
        """Whether any source asked for is of this topic."""
        return self.sources is None or any(s.startswith(f"{topic}.") for s in self.sources)


def format_of(path: Path) -> Format:
    """The format of a log, from its first bytes, else from its suffix.

    Raises LogError where there is no such file or the format is not known.
    """
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return "rosbag"
        if (path / "meta" / "info.json").exists():
            return "lerobot"
        raise LogError(
            f"{path.name!r} is a folder that holds neither metadata.yaml nor meta/info.json",
            expected="a rosbag2 or LeRobot folder, or the paths of single logs",
            do="pass the logs in it by name",
        )
    if not path.exists():
        raise LogError(f"there is no log {str(path)!r}", expected="an existing file", do="check the path")
    with path.open("rb") as file:
        head = file.read(16)
    if not head:
        raise LogError(f"{path.name!r} is empty", expected="a log with data in it", do="record it again")
    for magic, name in _MAGIC:
        if head.startswith(magic):
            return name
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise LogError(
            f"{path.name!r} is of no known format",
            expected=f"one of {', '.join(_SUFFIXES)}",
            do="export the log to CSV, Parquet or MCAP",
        )
    return _SUFFIXES[suffix]


def read_log(path: str | Path, options: ReadOptions | None = None) -> RawLog:
    """Read every numeric signal of one log file, rosbag2 folder or LeRobot dataset.

    Source names are "topic.field[index]" for messages (for sensor_msgs/JointState also
    "topic.position[joint name]") and the column's name for tables.

    Raises LogError where the log cannot be read. A damaged MCAP is read as far as possible, with a finding
    that says how many messages were read and how many are lost.
    """
    path = Path(path)
    reader = importlib.import_module(_READERS[format_of(path)])
    return reader.read(path, options or ReadOptions())

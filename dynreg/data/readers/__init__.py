"""The table of log formats, and one module each with `read(path, options) -> RawLog`; plugins by entry points."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from dynreg.data.series import RawLog
from dynreg.errors import LogError
from dynreg.plugins import with_plugins


@dataclass(frozen=True)
class LogFormat:
    """One format of logs.

    module : where its `read` is; it imports its libraries, which load when a log of that kind is met.
    magic : first bytes, any of which tell it. suffixes : in small letters; they tell where no first bytes do.
    folder : a file that a folder of that kind holds, and what such a folder is called.
    """

    name: str
    module: str
    magic: tuple[bytes, ...] = ()
    suffixes: tuple[str, ...] = ()
    folder: tuple[str, str] | None = None


_HDF = b"\x89HDF\r\n\x1a\n"
_PACKAGED = (
    LogFormat("mcap", f"{__name__}.mcap_log", (b"\x89MCAP0\r\n",), (".mcap",)),
    LogFormat(
        "rosbag",
        f"{__name__}.rosbag",
        (b"#ROSBAG V", b"SQLite format 3\x00"),
        (".bag", ".db3"),
        ("metadata.yaml", "rosbag2"),
    ),
    LogFormat("csv", f"{__name__}.tables", (), (".csv", ".tsv")),
    LogFormat("parquet", f"{__name__}.tables", (b"PAR1",), (".parquet",)),
    LogFormat("matlab", f"{__name__}.matlab", (b"MATLAB 5.0", b"MATLAB 7.3", _HDF), (".mat",)),
    LogFormat("bam", f"{__name__}.bam", (), (".json",)),
    LogFormat("lerobot", f"{__name__}.lerobot", folder=("meta/info.json", "LeRobot")),
)


@cache
def formats() -> Mapping[str, LogFormat]:
    """{name: format}: those of dynreg, and those of installed plugins.

    A plugin is a `LogFormat` under the entry point group `dynreg.readers`; RobotError where one is none.
    """
    packaged = {form.name: form for form in _PACKAGED}
    expected = "a dynreg.data.readers.LogFormat"
    return with_plugins(packaged, "dynreg.readers", "name", _made, expected)


def _made(plugin: Any) -> LogFormat | None:
    return plugin if isinstance(plugin, LogFormat) else None


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


def format_of(path: Path) -> LogFormat:
    """The format of a log, from its first bytes, then from its suffix; of a folder, from what it holds.

    Raises LogError where there is no such file or the format is not known.
    """
    if path.is_dir():
        folders = {f.folder: f for f in formats().values() if f.folder}
        for (file, _), form in folders.items():
            if (path / file).exists():
                return form
        raise LogError(
            f"{path.name!r} is a folder that holds neither {' nor '.join(file for file, _ in folders)}",
            expected=f"a {' or '.join(called for _, called in folders)} folder, or the paths of single logs",
            do="pass the logs in it by name",
        )
    if not path.exists():
        raise LogError(f"there is no log {str(path)!r}", expected="an existing file", do="check the path")
    with path.open("rb") as file:
        head = file.read(64)
    if not head:
        raise LogError(f"{path.name!r} is empty", expected="a log with data in it", do="record it again")
    begun = [f for f in formats().values() if head.startswith(f.magic)]
    named = [f for f in formats().values() if path.suffix.lower() in f.suffixes]
    told = [f for f in begun if f in named] or begun or named  # several formats may begin alike
    if not told:
        raise LogError(
            f"{path.name!r} is of no known format",
            expected=f"one of {', '.join(suffix for f in formats().values() for suffix in f.suffixes)}",
            do="export the log to CSV, Parquet or MCAP",
        )
    return told[0]


def read_log(path: str | Path, options: ReadOptions | None = None) -> RawLog:
    """Read every numeric signal of one log file, rosbag2 folder or LeRobot dataset.

    Source names are "topic.field[index]" for messages (for sensor_msgs/JointState also
    "topic.position[joint name]") and the column's name for tables.

    Raises LogError where the log cannot be read. A damaged MCAP is read as far as possible, with a finding
    that says how many messages were read and how many are lost.
    """
    path = Path(path)
    return import_module(format_of(path).module).read(path, options or ReadOptions())

"""The table of log formats, and one module each with `read(file, options) -> RawLog`; plugins by entry points."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from dynreg.data.logfile import LogFile
from dynreg.data.series import RawLog
from dynreg.errors import DynregError, LogError
from dynreg.plugins import with_plugins


@dataclass(frozen=True)
class LogFormat:
    """One format of logs.

    module : where its `read` is; it imports its libraries, which load when a log of that kind is met.
    magic : first bytes, any of which tell it. suffixes : in small letters; they tell where no first bytes do.
    folder : a file that a folder of that kind holds, and what such a folder is called.
    streams : its `read` is given a `LogFile`, so that nothing need be on disk; that of others is given a path.
    """

    name: str
    module: str
    magic: tuple[bytes, ...] = ()
    suffixes: tuple[str, ...] = ()
    folder: tuple[str, str] | None = None
    streams: bool = False


_HDF = b"\x89HDF\r\n\x1a\n"
_PACKAGED = (
    LogFormat("mcap", f"{__name__}.mcap_log", (b"\x89MCAP0\r\n",), (".mcap",), streams=True),
    LogFormat(
        "rosbag",
        f"{__name__}.rosbag",
        (b"#ROSBAG V", b"SQLite format 3\x00"),
        (".bag", ".db3"),
        ("metadata.yaml", "rosbag2"),
    ),
    LogFormat("csv", f"{__name__}.tables", (), (".csv", ".tsv"), streams=True),
    LogFormat("parquet", f"{__name__}.parquet", (b"PAR1",), (".parquet",), streams=True),
    LogFormat("matlab", f"{__name__}.matlab", (b"MATLAB 5.0", b"MATLAB 7.3", _HDF), (".mat",), streams=True),
    LogFormat("npz", f"{__name__}.npz", (b"PK\x03\x04",), (".npz",), streams=True),
    LogFormat("bam", f"{__name__}.bam", (), (".json",), streams=True),
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
    """The map's options for reading: the column or stamp that is the clock, and its unit.

    `time` is a table's time column, or "log" for messages whose header stamps are not to be used;
    None takes the usual names and header stamps. `time_unit` is s, ms, us or ns; None takes the one that the
    column's name states, or s. `sources` are the names that will be asked for, so that topics without any
    (images, scans) need not be decoded; None asks for all.
    """

    time: str | None = None
    time_unit: str | None = None
    sources: tuple[str, ...] | None = None

    def wants(self, topic: str) -> bool:
        """Whether any source asked for is of this topic."""
        return self.sources is None or any(s.startswith((f"{topic}.", f"{topic}[")) for s in self.sources)

    def wants_signal(self, name: str) -> bool:
        """Whether this signal is asked for, or an item of this column's lists."""
        return self.sources is None or any(s == name or s.startswith(f"{name}[") for s in self.sources)


def format_of(source: str | Path | LogFile) -> LogFormat:
    """The format of a log, from its first bytes, then from its suffix; of a folder, from what it holds.

    Raises LogError where there is no such file or the format is not known.
    """
    file = LogFile.of(source)
    if file.folder is not None:
        return _folder_format(file.folder)
    with file.open() as stream:
        head = stream.read(64)
    if not head:
        raise LogError(f"{file.name!r} is empty", expected="a log with data in it", do="record it again")
    begun = [f for f in formats().values() if head.startswith(f.magic)]
    named = [f for f in formats().values() if file.path.suffix.lower() in f.suffixes]
    told = [f for f in begun if f in named] or begun or named  # several formats may begin alike
    if not told:
        raise LogError(
            f"{file.name!r} is of no known format",
            expected=f"one of {', '.join(suffix for f in formats().values() for suffix in f.suffixes)}",
            do="export the log to CSV, Parquet or MCAP",
        )
    return told[0]


def _folder_format(path: Path) -> LogFormat:
    folders = {f.folder: f for f in formats().values() if f.folder}
    for (file, _), form in folders.items():
        if (path / file).exists():
            return form
    raise LogError(
        f"{path.name!r} is a folder that holds neither {' nor '.join(file for file, _ in folders)}",
        expected=f"a {' or '.join(called for _, called in folders)} folder, or the paths of single logs",
        do="pass the logs in it by name",
    )


def read_log(source: str | Path | LogFile, options: ReadOptions | None = None) -> RawLog:
    """Read every numeric signal of one log file, rosbag2 folder or LeRobot dataset, or of bytes in memory.

    Source names are "topic.field[index]" for messages (for sensor_msgs/JointState also
    "topic.position[joint name]") and the column's name for tables.

    Raises LogError where the log cannot be read. A damaged MCAP is read as far as possible, with a finding
    that says how many messages were read and how many are lost.
    """
    file = LogFile.of(source)
    form = format_of(file)
    try:
        module = import_module(form.module)
        if form.streams:
            log = module.read(file, options or ReadOptions())
        else:
            with file.on_disk() as path:
                log = module.read(path, options or ReadOptions())
        return replace(log, path=file.path, stem=file.stem)
    except DynregError:
        raise
    except (
        Exception
    ) as error:  # what a stranger wrote may fail a library in any way, for want of memory or depth too
        raise LogError(
            f"{file.name!r} cannot be read as {form.name}: {str(error) or type(error).__name__}",
            expected="a whole log of that format",
            do="export or record it again",
        ) from error

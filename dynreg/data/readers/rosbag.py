"""ROS 1 bags (read with the rosbags library), rosbag2 .db3 files and rosbag2 folders."""

import bz2
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import BufferedReader, FileIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.bag_folder import bag_information, stated_counts
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.channel import Channel
from dynreg.data.readers.db3 import read as read_db3
from dynreg.data.readers.mcap_log import read as read_mcap
from dynreg.data.readers.mcap_walk import inflate
from dynreg.data.readers.merge import join
from dynreg.data.readers.ros_types import ros_decoder
from dynreg.data.readers.topics import Topics
from dynreg.data.series import RawLog
from dynreg.errors import DynregError, LogError

_PIECE = 1 << 20


def read(path: Path, options: ReadOptions) -> RawLog:
    """Read a .bag, a .db3 or a rosbag2 folder.

    Raises LogError for a bag without its index (a recording that was cut off) and for damaged ones.
    """
    try:
        if path.is_dir():
            return _read_folder(path, options)
        with path.open("rb") as file:
            database = file.read(6) == b"SQLite"
        return read_db3(path, options) if database else _read_bag(path, options)
    except DynregError:
        raise
    except (
        Exception
    ) as error:  # rosbags, sqlite3, bz2, lz4 and zstd each have their own errors for a damaged file
        raise LogError(
            f"{path.name!r} cannot be read: {str(error) or type(error).__name__}",
            expected="a whole bag with its index",
            do="mend it with `rosbag reindex` or `ros2 bag reindex`, or record it again",
        ) from error


def _read_bag(path: Path, options: ReadOptions) -> RawLog:
    from rosbags.rosbag1 import Reader

    budget = Budget(path.name)
    topics = Topics(options, budget)
    with Reader(_Path(path)) as bag:
        for place, chunk in bag.chunks.items():
            bag.chunks[place] = chunk._replace(decompressor=partial(_bounded, chunk.decompressor, budget))
        channels = {
            c.id: Channel(
                c.topic, partial(ros_decoder, c.msgtype, c.msgdef.data, "ros1msg", "ros1", budget), c.msgtype
            )
            for c in bag.connections
        }
        wanted = [c for c in bag.connections if options.wants(c.topic)]
        for connection, stamp, data in bag.messages(wanted) if wanted else ():
            channel = channels[connection.id]
            message = channel.decode(data)
            if message is not None:
                topics.add(channel.topic, message, stamp, channel.kind)
        count = bag.message_count
    log = topics.log(path)
    names = sorted({channel.topic for channel in channels.values()})
    metadata = {**log.metadata, "messages_read": count, "messages_lost": 0, "topics": names}
    findings = [finding for channel in channels.values() for finding in channel.findings(path.name)]
    return replace(log, metadata=metadata, findings=(*findings, *log.findings))


class _Path:
    """A bag's path as rosbags takes it; its streams hold themselves to what the file has."""

    def __init__(self, path: Path):
        self._path = path

    def __str__(self) -> str:
        return str(self._path)

    def exists(self) -> bool:
        return self._path.exists()

    def open(self, mode: str) -> BinaryIO:
        return _Stream(FileIO(self._path, mode))


class _Stream(BufferedReader):
    """A file that is read no further than its end: for a length that is wrong no memory is asked for."""

    def read(self, size: int | None = -1) -> bytes:
        if size is not None and size > _PIECE:
            size = min(size, os.fstat(self.fileno()).st_size)
        return super().read(size)


def _bounded(unpack: Callable[[bytes], bytes], budget: Budget, data: bytes) -> bytes:
    """A chunk of a ROS 1 bag, unpacked as far as the limit allows; `unpack` is what the library would do."""
    allowed = budget.allowed("chunk_bytes")
    if data.startswith(b"BZh"):
        out = bz2.BZ2Decompressor().decompress(data, allowed + 1)
    elif data.startswith(b"\x04\x22\x4d\x18"):
        out = bytes(inflate("lz4", data, allowed + 1)[0])
    else:
        out = unpack(data)
    budget.check("chunk_bytes", len(out))
    budget.spend("unpacked_bytes", len(out))
    return out


def _read_folder(path: Path, options: ReadOptions) -> RawLog:
    """All files of a rosbag2 folder, one after the other."""
    budget = Budget(path.name)
    info = bag_information(path)
    counts, packed = stated_counts(info), info.get("compression_mode") or ""
    logs = []
    for name in info["relative_file_paths"]:
        budget.spend("log_files")
        file = path / Path(str(name)).name
        if not file.is_file():
            raise LogError(
                f"{path.name!r} lacks its file {file.name!r}", expected="all its files", do="copy it again"
            )
        with _unpacked(file, budget, str(packed).lower() == "file") as plain:
            if info.get("storage_identifier") == "mcap":
                logs.append(read_mcap(LogFile(plain), options, counts.get(file.name)))
            elif str(packed).lower() == "message":
                logs.append(read_db3(plain, options, partial(_unpacked_message, budget)))
            else:
                logs.append(read_db3(plain, options))
    return join(path, logs)


@contextmanager
def _unpacked(file: Path, budget: Budget, packed: bool) -> Iterator[Path]:
    """The file, or a copy that is unpacked where zstd packed it as a whole."""
    if not packed:
        yield file
        return
    import zstandard

    with TemporaryDirectory(prefix="dynreg-") as folder:
        plain = Path(folder) / file.name.removesuffix(".zstd")
        with file.open("rb") as source, plain.open("wb") as out:
            stream = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
            while piece := stream.read(_PIECE):
                budget.spend("unpacked_bytes", len(piece))
                out.write(piece)
        yield plain


def _unpacked_message(budget: Budget, data: bytes) -> bytes:
    out, problem = inflate("zstd", data, budget.allowed("chunk_bytes"))
    if problem not in (None, "cut off"):  # its length is not told beforehand
        raise ValueError(problem)
    budget.spend("unpacked_bytes", len(out))
    return bytes(out)

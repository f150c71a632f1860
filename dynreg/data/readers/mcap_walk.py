"""Walks the records of an MCAP file, damaged or whole, and counts what cannot be had.

The library's readers stop at the first damaged byte; a robot that lost power mid-run leaves just such a file.
Format: https://mcap.dev/spec
"""

import struct
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from dynreg.data.logfile import LogFile
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.mcap_summary import HEAD, Summary

MAGIC_BYTES = 8
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of the compression's name
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
_READ = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE_INDEX)
_WINDOW = 1 << 27  # bytes that zstd may look back, what its own program allows
_PIECE = 1 << 20
_TOLD = 3  # problems that are told

Item = Schema | Channel | Message
Wants = Callable[[str], bool]


@dataclass
class Tally:
    """Counts of a walk through a file, filled while it runs.

    `lost` counts messages known to be gone (from message indexes); `guessed` those reckoned from the size of
    what is missing; `stopped` is the byte where nothing more could be read, None where the data was read to
    its end (the summary after it holds no messages).
    """

    read: int = 0
    lost: int = 0
    guessed: int = 0
    stopped: int | None = None
    size: int = 0
    message_bytes: int = 0
    problems: list[str] = field(default_factory=list)

    def problem(self, text: str) -> None:
        """Enter what is wrong, the first of many."""
        if len(self.problems) < _TOLD:
            self.problems.append(text)


@dataclass
class _Open:
    """The chunk whose message indexes are being counted; one that was passed over is known by these alone."""

    read: int
    guessed: int
    damaged: bool
    indexed: int = 0
    passed_over: bool = False


def walk(source: LogFile, tally: Tally, summary: Summary, wants: Wants, budget: Budget) -> Iterator[Item]:
    """Schemas, channels and the messages of the topics that `wants` names, in file order.

    `tally` tells afterwards what was lost. A chunk that its index says holds none of these topics is not unpacked: the
    channels then come from the summary. Raises LogError past a limit.
    """
    tally.size = source.size
    resume = sorted(c.chunk_start_offset for c in summary.chunks)
    walker = _Walker(tally, wants, budget)
    closed = summary.passed_over(wants)
    if closed:
        yield from map(walker.known, (*summary.schemas, *summary.channels))
    chunk: _Open | None = None
    with source.open() as file:
        at = MAGIC_BYTES
        while True:
            file.seek(at)
            head = file.read(HEAD.size)
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            end = at + HEAD.size + length
            large = opcode in _READ and length > budget.allowed("chunk_bytes")
            whole = 0 < opcode and end <= tally.size and not large
            if opcode != Opcode.MESSAGE_INDEX or not whole:
                _settle(chunk, tally)
                chunk = None
            if whole and opcode == Opcode.CHUNK and at in closed:
                chunk = _Open(0, 0, False, passed_over=True)
            if opcode == Opcode.MESSAGE_INDEX and whole and chunk is not None:
                # channel (2 bytes), length (4), then 16 bytes a message
                chunk.indexed += max(length - 6, 0) // 16
            elif opcode == Opcode.CHUNK and chunk is None:
                chunk = yield from walker.chunk(file.read(min(length, budget.allowed("chunk_bytes"))), at)
            elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL) and whole:
                yield from walker.items(opcode, memoryview(file.read(length)))
            elif opcode == Opcode.MESSAGE and length < tally.size:
                tally.guessed += 1
            if whole:
                at = end
                continue
            tally.problem(budget.past("chunk_bytes", length) if large else f"no whole record at byte {at}")
            after = bisect_right(resume, at)
            if after == len(resume):
                tally.stopped = file.tell() if len(head) == HEAD.size else tally.size
                break
            at = resume[after]
    _settle(chunk, tally)


def _settle(chunk: _Open | None, tally: Tally) -> None:
    """Enter a damaged chunk's losses, exactly where its message indexes survived."""
    if chunk is None:
        return
    if chunk.passed_over:
        tally.read += chunk.indexed
    elif chunk.damaged and chunk.indexed:
        tally.lost += max(chunk.indexed - chunk.read, 0)
    elif chunk.damaged:
        tally.guessed += chunk.guessed


@dataclass
class _Walker:
    """The records of a file and of its chunks, one after the other."""

    tally: Tally
    wants: Wants
    budget: Budget
    unwanted: set[int] = field(default_factory=set)

    def known(self, item: Schema | Channel) -> Schema | Channel:
        """A schema or a channel; remembers which channels are not asked for."""
        if isinstance(item, Channel) and not self.wants(item.topic):
            self.unwanted.add(item.id)
        return item

    def chunk(self, body: bytes, at: int) -> Iterator[Item]:
        """The records of one chunk, as far as they can be unpacked; returns what its index is to confirm."""
        tally = self.tally
        if len(body) < _CHUNK.size:
            return _Open(0, 1, True)
        first, last, size, crc, name_length = _CHUNK.unpack_from(body)
        allowed = self.budget.allowed("chunk_bytes")
        if size > allowed:  # noise, or a chunk that is made to fill the memory
            tally.problem(self.budget.past("chunk_bytes", size))
            size = allowed
        data_at = _CHUNK.size + name_length + 8
        compression = body[_CHUNK.size : _CHUNK.size + min(name_length, 64)].decode("ascii", "replace")
        (length,) = struct.unpack("<Q", body[data_at - 8 : data_at]) if len(body) >= data_at else (0,)
        data, problem = inflate(compression, memoryview(body)[data_at : data_at + length], size)
        self.budget.spend("unpacked_bytes", len(data))
        noise = problem is None and len(data) == size and crc and zlib.crc32(data) != crc
        if noise:
            tally.problem(f"the chunk at byte {at} fails its checksum: its numbers may be wrong")
        before, used, records = tally.read, 0, memoryview(data)
        while used + HEAD.size <= len(data):
            opcode, length = HEAD.unpack_from(data, used)
            end = used + HEAD.size + length
            if opcode == 0 or end > len(data):
                break
            yield from self.items(opcode, records[used + HEAD.size : end], (first, last))
            used = end
        read = tally.read - before
        if used >= size and problem is None and not noise:
            return _Open(read, 0, False)
        if not noise:
            tally.problem(f"the chunk at byte {at} is damaged ({problem or 'cut off'})")
        # Messages of one log are much alike, so the bytes that are missing tell about how many are.
        guessed = round((size - used) * tally.read / tally.message_bytes) if tally.read else 1
        return _Open(read, guessed, True)

    def items(self, opcode: int, body: memoryview, times: tuple[int, int] | None = None) -> Iterator[Item]:
        """One record's item; none for a message that lies outside its chunk's `times` [ns], which is noise."""
        try:
            if opcode == Opcode.MESSAGE and len(body) >= _MESSAGE.size:
                channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
                if times is not None and not times[0] <= log_time <= times[1]:
                    return
                self.tally.read += 1
                self.tally.message_bytes += HEAD.size + len(body)
                item = Message(channel, log_time, body[_MESSAGE.size :], publish_time, sequence)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                record = Schema if opcode == Opcode.SCHEMA else Channel
                item = self.known(record.read(ReadDataStream(BytesIO(body))))
            else:
                return
        except Exception as error:  # a record of noise can fail in any way; the walk goes on
            self.tally.problem(f"unreadable record of type {opcode}: {error}")
            return
        if not isinstance(item, Message) or item.channel_id not in self.unwanted:
            yield item


def inflate(
    compression: str, data: bytes | memoryview, size: int
) -> tuple[bytes | bytearray | memoryview, str | None]:
    """Unpack a chunk as far as it goes: at most `size` bytes, and what stopped it before its end."""
    if compression == "":
        return data[:size], None
    if compression == "zstd":
        import zstandard

        stream = zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(
            data, read_across_frames=True
        )
        pieces = iter(lambda: stream.read(_PIECE), b"")
    elif compression == "lz4":
        import lz4.frame

        unpack = lz4.frame.LZ4FrameDecompressor()
        pieces = (unpack.decompress(data[at : at + 4096]) for at in range(0, len(data), 4096))
    else:
        return b"", f"compression {compression!r} is not known"
    out = bytearray()
    try:
        for piece in pieces:
            out += piece[: size - len(out)]
            if len(out) >= size:
                break
    except Exception as error:  # zstd and lz4 have unrelated roots; whatever was unpacked before is good
        return out, str(error)
    return out, None if len(out) >= size else "cut off"

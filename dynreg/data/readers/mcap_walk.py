"""Walks the records of an MCAP file, damaged or whole, and counts what cannot be had.

The library's readers stop at the first damaged byte; a robot that lost power mid-run leaves just such a file.
Format: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from dynreg.data.logfile import LogFile

MAGIC_BYTES = 8
RECORD_LIMIT = 1 << 30  # bytes of one record and of one chunk unpacked
_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of the compression's name
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data

Item = Schema | Channel | Message


@dataclass
class Tally:
    """What a walk met, filled while it runs.

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


@dataclass
class _Open:
    """The chunk whose message indexes are being counted."""

    read: int
    guessed: int
    damaged: bool
    indexed: int = 0


def walk(source: LogFile, tally: Tally) -> Iterator[Item]:
    """Schemas, channels and messages in file order; `tally` tells afterwards what was lost."""
    tally.size = source.size
    summary = summary_of(source)
    resume = sorted(c.chunk_start_offset for c in summary.chunk_indexes) if summary else []
    chunk: _Open | None = None
    with source.open() as file:
        at = MAGIC_BYTES
        while True:
            file.seek(at)
            head = file.read(_HEAD.size)
            opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            end = at + _HEAD.size + length
            whole = 0 < opcode and length <= RECORD_LIMIT and end <= tally.size
            if opcode != Opcode.MESSAGE_INDEX or not whole:
                _settle(chunk, tally)
                chunk = None
            if opcode == Opcode.MESSAGE_INDEX and whole and chunk is not None:
                # channel (2 bytes), length (4), then 16 bytes a message
                chunk.indexed += max(len(file.read(length)) - 6, 0) // 16
            elif opcode == Opcode.CHUNK:
                chunk = yield from _chunk(file.read(min(length, RECORD_LIMIT)), at, tally)
            elif whole:
                yield from _items(opcode, file.read(length), tally)
            elif opcode == Opcode.MESSAGE and length < tally.size:
                tally.guessed += 1
            if whole:
                at = end
                continue
            tally.problems.append(f"no whole record at byte {at}")
            at = next((offset for offset in resume if offset > at), -1)
            if at < 0:
                tally.stopped = file.tell() if len(head) == _HEAD.size else tally.size
                break
    _settle(chunk, tally)


def _settle(chunk: _Open | None, tally: Tally) -> None:
    """Enter a damaged chunk's losses, exactly where its message indexes survived."""
    if chunk is None or not chunk.damaged:
        return
    if chunk.indexed:
        tally.lost += max(chunk.indexed - chunk.read, 0)
    else:
        tally.guessed += chunk.guessed


def _chunk(body: bytes, at: int, tally: Tally) -> Iterator[Item]:
    """The records of one chunk, as far as they can be unpacked; returns what its index is to confirm."""
    if len(body) < _CHUNK.size:
        return _Open(0, 1, True)
    first, last, size, crc, name_length = _CHUNK.unpack_from(body)
    data_at = _CHUNK.size + name_length + 8
    compression = body[_CHUNK.size : _CHUNK.size + name_length].decode("ascii", "replace")
    (data_length,) = struct.unpack("<Q", body[data_at - 8 : data_at]) if len(body) >= data_at else (0,)
    data, problem = inflate(compression, body[data_at : data_at + data_length], size)
    noise = problem is None and len(data) == size and crc and zlib.crc32(data) != crc
    if noise:
        tally.problems.append(f"the chunk at byte {at} fails its checksum: its numbers may be wrong")
    before, used = tally.read, 0
    while used + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, used)
        end = used + _HEAD.size + length
        if opcode == 0 or end > len(data):
            break
        yield from _items(opcode, data[used + _HEAD.size : end], tally, (first, last))
        used = end
    read = tally.read - before
    if used >= size and problem is None and not noise:
        return _Open(read, 0, False)
    if not noise:
        tally.problems.append(f"the chunk at byte {at} is damaged ({problem or 'cut off'})")
    # Messages of one log are much alike, so the bytes that are missing tell about how many are.
    guessed = round((size - used) * tally.read / tally.message_bytes) if tally.read else 1
    return _Open(read, guessed, True)


def inflate(compression: str, data: bytes, size: int) -> tuple[bytes, str | None]:
    """Unpack a chunk as far as it goes: at most `size` bytes, and what stopped it before its end."""
    size = min(size, RECORD_LIMIT)
    if compression == "":
        return data[:size], None
    if compression == "zstd":
        import zstandard

        unpack = zstandard.ZstdDecompressor(max_window_size=1 << 28).decompressobj()
    elif compression == "lz4":
        import lz4.frame

        unpack = lz4.frame.LZ4FrameDecompressor()
    else:
        return b"", f"compression {compression!r} is not known"
    out = bytearray()
    try:
        for start in range(0, len(data), 4096):
            out += unpack.decompress(data[start : start + 4096])
            if len(out) >= size:
                break
    except Exception as error:  # zstd and lz4 have unrelated roots; whatever was unpacked before is good
        return bytes(out[:size]), str(error)
    return bytes(out[:size]), None if len(out) >= size else "cut off"


def _items(opcode: int, body: bytes, tally: Tally, times: tuple[int, int] | None = None) -> Iterator[Item]:
    """One record's item; none for a message that lies outside its chunk's `times` [ns], which is noise."""
    try:
        if opcode == Opcode.MESSAGE and len(body) >= _MESSAGE.size:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
            if times is None or times[0] <= log_time <= times[1]:
                tally.read += 1
                tally.message_bytes += _HEAD.size + len(body)
                yield Message(channel, log_time, body[_MESSAGE.size :], publish_time, sequence)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            record = Schema if opcode == Opcode.SCHEMA else Channel
            yield record.read(ReadDataStream(BytesIO(body)))
    except Exception as error:  # a record of noise can fail in any way; the walk goes on
        tally.problems.append(f"unreadable record of type {opcode}: {error}")


def summary_of(source: LogFile):
    """The mcap Summary at the end of a file; None where it is cut off or damaged."""
    from mcap.reader import SeekingReader

    with source.open() as file:
        try:
            reader = SeekingReader(file, record_size_limit=RECORD_LIMIT)
            file.seek(0)
            return reader.get_summary()
        except Exception:  # noise can fail in any way
            return None

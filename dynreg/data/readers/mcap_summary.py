"""The summary at the end of an MCAP file: its chunks, its channels, and the number of messages.

Read record by record, without the library's own reader, which unpacks whatever lies where the file says.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from dynreg.data.logfile import LogFile
from dynreg.data.readers.budget import Budget

HEAD = struct.Struct("<BQ")  # opcode, length
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, offset start, checksum
_MAGIC = 8  # bytes at either end
_RECORDS = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
}


@dataclass
class Summary:
    """The records of a file's summary, as far as they are used; none where it is cut off or damaged."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    messages: int | None = None

    def passed_over(self, wants: Callable[[str], bool]) -> frozenset[int]:
        """The offsets of chunks that hold messages, but none of a topic for which `wants` is true."""
        topics = {channel.id: channel.topic for channel in self.channels}
        unwanted = {number for number, topic in topics.items() if not wants(topic)}
        return frozenset(
            chunk.chunk_start_offset
            for chunk in self.chunks
            if chunk.message_index_offsets and chunk.message_index_offsets.keys() <= unwanted
        )


def summary_of(source: LogFile, budget: Budget) -> Summary:
    """The summary at the end of a file."""
    size = source.size
    with source.open() as file:
        file.seek(max(size - _MAGIC - _FOOTER.size, 0))
        footer = file.read(_FOOTER.size)
        if len(footer) < _FOOTER.size:
            return Summary()
        opcode, _, start, _, checksum = _FOOTER.unpack(footer)
        length = size - _MAGIC - _FOOTER.size - start
        if opcode != Opcode.FOOTER or start == 0 or not 0 < length <= budget.allowed("chunk_bytes"):
            return Summary()
        file.seek(start)
        section = file.read(length)
    if checksum and zlib.crc32(section + footer[:-4]) != checksum:
        return Summary()
    out = Summary()
    try:
        for record in _records(section):
            if isinstance(record, Statistics):
                out.messages = record.message_count
            else:
                kept = {Schema: out.schemas, Channel: out.channels, ChunkIndex: out.chunks}[type(record)]
                kept.append(record)
    except Exception:  # noise can fail in any way
        return Summary()
    return out


def _records(section: bytes) -> Iterator[Schema | Channel | ChunkIndex | Statistics]:
    at = 0
    while at + HEAD.size <= len(section):
        opcode, length = HEAD.unpack_from(section, at)
        at += HEAD.size
        if opcode in _RECORDS:
            yield _RECORDS[opcode].read(ReadDataStream(BytesIO(section[at : at + length])))
        at += length

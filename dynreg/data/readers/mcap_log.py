"""MCAP files: ROS 2 (CDR), ROS 1, JSON and protobuf messages, whole or damaged."""

import json
from typing import Any

from mcap.records import Channel, Schema

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.bag_folder import bag_information, stated_counts
from dynreg.data.readers.mcap_walk import Tally, summary_of, walk
from dynreg.data.readers.messages import Topic, gather
from dynreg.data.readers.ros_types import Decode, ros_decoder
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError


def read(file: LogFile, options: ReadOptions, expected: int | None = None) -> RawLog:
    """Read an MCAP file; of a damaged one as much as is left.

    `expected` is the number of messages that a rosbag2 folder's metadata states. Where messages are lost a
    finding tells how many; `messages_read` and `messages_lost` (None where it cannot be known) are in the
    log's metadata. Raises LogError where not one message could be read.
    """
    tally = Tally()
    schemas: dict[int, Schema] = {}
    channels: dict[int, _Channel] = {}
    topics: dict[str, Topic] = {}
    for item in walk(file, tally):
        if isinstance(item, Schema):
            schemas.setdefault(item.id, item)
        elif isinstance(item, Channel):
            channels.setdefault(item.id, _Channel(item, schemas.get(item.schema_id)))
        elif item.channel_id in channels and options.wants(channels[item.channel_id].topic):
            channel = channels[item.channel_id]
            message = channel.decode(item.data)
            if message is not None:
                topics.setdefault(channel.topic, Topic(channel.topic)).add(message, item.log_time)
    findings = [f for channel in channels.values() for f in channel.findings(file.name)]
    lost, damage = _losses(file.name, tally, expected if expected is not None else _stated(file))
    if not tally.read or (not topics and options.sources is None):
        raise LogError(
            f"{file.name!r} holds no message that can be read ({'; '.join(tally.problems[:1]) or 'no data'})",
            expected="ROS 2, ROS 1, JSON or protobuf messages",
            do="record it again, or convert it with `mcap recover`",
        )
    sources, metadata, found = gather(topics, options.time != "log")
    metadata.update(
        messages_read=tally.read, messages_lost=lost, topics=sorted(c.topic for c in channels.values())
    )
    return RawLog(file.path, sources, metadata, findings=(*damage, *findings, *found))


def _stated(file: LogFile) -> int | None:
    """Messages that the file should hold: from its own summary, else from the metadata.yaml beside it."""
    summary = summary_of(file)
    if summary and summary.statistics:
        return summary.statistics.message_count
    beside = file.path.parent
    if file.data is not None or not (beside / "metadata.yaml").exists():
        return None
    try:
        return stated_counts(bag_information(beside)).get(file.name)
    except LogError:
        return None


def _losses(name: str, tally: Tally, stated: int | None) -> tuple[int | None, list[Finding]]:
    """Messages lost (None: unknown) and the findings that say so."""
    if stated in (None, tally.read) and tally.stopped is None and not tally.problems:
        return 0, []
    where = name if tally.stopped is None else f"{name}, byte {tally.stopped} of {tally.size}"
    cause = "; ".join(tally.problems[:3]) or "fewer messages than the summary states"
    known = tally.lost + tally.guessed
    lost: int | None = None
    if stated is not None:
        lost = max(stated - tally.read, 0)
        text = f"{lost} lost of {stated}"
    elif tally.stopped is None:
        lost = known
        text = f"{'about ' if tally.guessed else ''}{lost} lost"
    else:
        text = (
            f"{'about' if tally.guessed else 'at least'} {known} lost, and"
            if known
            else "an unknown number lost:"
        )
        text += " whatever followed in the part that is gone"
    if lost == 0 and tally.stopped is None:
        return 0, [Finding("warning", "damage", where, f"{cause}; all {tally.read} messages were read")]
    return lost, [Finding("warning", "lost", where, f"{tally.read} messages read, {text} ({cause})")]


class _Channel:
    """One channel of the file: how its messages are decoded, and how many could not be."""

    def __init__(self, channel: Channel, schema: Schema | None):
        self.topic = channel.topic
        self.failed = 0
        self.problem = ""
        self._decode: Decode | None = None
        try:
            self._decode = _decoder(channel, schema)
            if self._decode is None:
                self.problem = f"encoding {channel.message_encoding!r} is not read"
        except Exception as error:  # the schema comes from the file: its parser may fail in any way
            self.problem = f"its schema cannot be used: {error}"

    def decode(self, data: bytes) -> Any:
        if self._decode is None:
            self.failed += 1
            return None
        try:
            return self._decode(data)
        except Exception as error:  # so may the message's decoder
            self.failed += 1
            self.problem = f"cannot be decoded: {error}"
            return None

    def findings(self, name: str) -> list[Finding]:
        if not self.failed:
            return []
        text = f"{self.failed} messages left out: {' '.join(self.problem.split())}"
        return [Finding("warning", "decode", f"{name}, {self.topic}", text)]


def _decoder(channel: Channel, schema: Schema | None) -> Decode | None:
    if channel.message_encoding == "json":
        return json.loads
    if schema is None:
        return None
    if channel.message_encoding == "protobuf":
        from mcap_protobuf.decoder import DecoderFactory

        return DecoderFactory().decoder_for("protobuf", schema)
    return ros_decoder(schema.name, schema.data.decode(), schema.encoding, channel.message_encoding)

"""MCAP files: ROS 2 (CDR), ROS 1, JSON and protobuf messages, whole or damaged."""

from dataclasses import replace
from functools import partial
from typing import Any

from mcap.records import Channel as Record
from mcap.records import Schema

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.bag_folder import bag_information, stated_counts
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.channel import Channel
from dynreg.data.readers.mcap_summary import Summary, summary_of
from dynreg.data.readers.mcap_walk import Tally, walk
from dynreg.data.readers.numbers import parse_json
from dynreg.data.readers.ros_types import Decode, ros_decoder
from dynreg.data.readers.topics import Topics
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError


def read(file: LogFile, options: ReadOptions, expected: int | None = None) -> RawLog:
    """Read an MCAP file; of a damaged one as much as is left.

    `expected` is the number of messages that a rosbag2 folder's metadata states. Where messages are lost a
    finding tells how many; `messages_read` and `messages_lost` (None where it cannot be known) are in the
    log's metadata. Raises LogError where not one message could be read.
    """
    budget = Budget(file.name)
    tally = Tally()
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    topics = Topics(options, budget)
    decoder = _Decoders(budget).of
    summary = summary_of(file, budget)
    for item in walk(file, tally, summary, options.wants, budget):
        if isinstance(item, Schema):
            schemas.setdefault(item.id, item)
        elif isinstance(item, Record):
            make = partial(decoder, item.message_encoding, schemas.get(item.schema_id))
            kind = schemas[item.schema_id].name if item.schema_id in schemas else ""
            channels.setdefault(item.id, Channel(item.topic, make, kind))
        elif item.channel_id in channels:
            channel = channels[item.channel_id]
            message = channel.decode(item.data)
            if message is not None:
                topics.add(channel.topic, message, item.log_time, channel.kind)
    findings = [f for channel in channels.values() for f in channel.findings(file.name)]
    lost, damage = _losses(file.name, tally, expected if expected is not None else _stated(file, summary))
    causes = iter((*tally.problems, *(finding.message for finding in findings)))
    if not tally.read or (not topics and options.sources is None):
        raise LogError(
            f"{file.name!r} holds no message that can be read ({next(causes, 'no data')})",
            expected="ROS 2, ROS 1, JSON or protobuf messages",
            do="record it again, or convert it with `mcap recover`",
        )
    log = topics.log(file.path)
    told = {
        "messages_read": tally.read,
        "messages_lost": lost,
        "topics": sorted(c.topic for c in channels.values()),
    }
    return replace(log, metadata={**log.metadata, **told}, findings=(*damage, *findings, *log.findings))


def _stated(file: LogFile, summary: Summary) -> int | None:
    """Messages that the file should hold: from its own summary, else from the metadata.yaml beside it."""
    if summary.messages is not None:
        return summary.messages
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
    cause = "; ".join(tally.problems) or "fewer messages than the summary states"
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


class _Decoders:
    """The decoders of one file, one a type and encoding: many channels may share them."""

    def __init__(self, budget: Budget):
        self._budget = budget
        self._made: dict[tuple[str, int], Decode | None] = {}

    def of(self, encoding: str, schema: Schema | None) -> Decode | None:
        """The decoder of messages in this encoding, None where it is not read; it raises whatever a schema makes it."""
        kind = (encoding, schema.id if schema else 0)
        if kind not in self._made:
            self._made[kind] = self._decoder(encoding, schema)
        return self._made[kind]

    def _decoder(self, encoding: str, schema: Schema | None) -> Decode | None:
        if encoding == "json":
            return self._json
        if schema is None:
            return None
        self._budget.check("settings_bytes", len(schema.data))
        if encoding == "protobuf":
            from mcap_protobuf.decoder import DecoderFactory

            self._budget.spend("types")
            decode = DecoderFactory().decoder_for("protobuf", schema)
            return decode and (lambda data: decode(bytes(data)))
        return ros_decoder(schema.name, schema.data.decode(), schema.encoding, encoding, self._budget)

    def _json(self, data: memoryview) -> Any:
        self._budget.check("json_bytes", len(data))
        return parse_json(bytes(data))

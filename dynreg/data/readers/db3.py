"""The SQLite files of rosbag2.

Read with Python's own sqlite3, from tables alone: a view in the place of a table may compute for ever.
"""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.channel import Channel
from dynreg.data.readers.ros_types import Decode, ros_decoder
from dynreg.data.readers.topics import Topics
from dynreg.data.series import RawLog

Unpack = Callable[[bytes], bytes]


def read(path: Path, options: ReadOptions, unpack: Unpack = bytes) -> RawLog:
    """Read a .db3 file, whose messages `unpack` unpacks. Raises sqlite3.Error and ValueError where it is damaged."""
    budget = Budget(path.name)
    topics = Topics(options, budget)
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(budget.allowed("chunk_bytes"), 10**9))
        database.execute("PRAGMA trusted_schema = OFF")
        database.text_factory = lambda text: text.decode(errors="replace")
        channels = dict(_channels(database, budget))
        wanted = {number: c for number, c in channels.items() if options.wants(c.topic)}
        (count,) = database.execute("SELECT count(*) FROM messages").fetchone()
        for number, stamp, data in _messages(database, wanted):
            channel = wanted[number]
            if not isinstance(stamp, int) or stamp < 0 or not isinstance(data, bytes):
                channel.leave_out("its stamp is no time, or its data no bytes")
                continue
            message = channel.decode(unpack(data))
            if message is not None:
                topics.add(channel.topic, message, stamp, channel.kind)
    log = topics.log(path)
    names = sorted({channel.topic for channel in channels.values()})
    metadata = {**log.metadata, "messages_read": count, "messages_lost": 0, "topics": names}
    findings = [finding for channel in channels.values() for finding in channel.findings(path.name)]
    return replace(log, metadata=metadata, findings=(*findings, *log.findings))


def _channels(database: sqlite3.Connection, budget: Budget) -> Iterator[tuple[int, Channel]]:
    tables = dict(database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'"))
    plain = {name for name, sql in tables.items() if not str(sql).upper().startswith("CREATE VIRTUAL")}
    if not {"topics", "messages"} <= plain:
        raise ValueError("it has no tables of topics and messages")
    told = {}
    if "message_definitions" in plain:
        rows = database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        told = {kind: (encoding, text) for kind, encoding, text in rows}
    for number, topic, kind, form in database.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        # older files carry no definitions: their types are the standard ones of Humble
        encoding, text = told.get(kind, ("ros2msg", None))
        yield (
            number,
            Channel(str(topic), partial(_decoder, str(kind), text, encoding, form, budget), str(kind)),
        )


def _decoder(kind: str, text: str | None, encoding: str, form: str, budget: Budget) -> Decode | None:
    return ros_decoder(kind, text, encoding, form, budget)


def _messages(database: sqlite3.Connection, wanted: dict[int, Channel]) -> Iterator[tuple[int, int, bytes]]:
    """Topic, stamp and data of the messages of these topics, by stamp."""
    if not wanted:
        return
    places = ", ".join("?" * len(wanted))
    query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({places}) ORDER BY timestamp"
    yield from database.execute(query, tuple(wanted))

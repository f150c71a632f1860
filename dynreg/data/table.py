"""Recordings as Arrow tables, Parquet, CSV and MCAP files, and back."""

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from dynreg.data.maps import LogMap
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.trajectories import KEYS, texts
from dynreg.errors import LimitError, LogError
from dynreg.limits import limits, refuse

SCHEMA = "dynreg/recording/2"
_OLD = "dynreg/recording/1"  # had episode, time and the channels alone
_KEY = b"dynreg"
_ABOUT = ("/episode", "/settings")  # topics of an MCAP file that tell of its episodes
_PAUSE = 1.0  # [s] between episodes in an MCAP file
_STAMP = 1e-9  # [s] of its stamps


def to_table(recording: Recording) -> pa.Table:
    """Columns `entry` (the id), `episode`, `step`, `time` [s], one a channel, and one a setting.

    A field's metadata tells its `role`, and the `unit` of times and channels. Settings are in SI units; one of the same
    name as another column is in the metadata alone. Names, settings, provenance and whether it was measured are JSON
    under `dynreg` in the schema's metadata.
    """
    rows = [len(e.time) for e in recording.episodes]
    number = np.repeat(np.arange(len(rows), dtype=np.int32), rows)
    values = np.concatenate([e.values for e in recording.episodes])
    columns = [
        ("entry", texts([recording.id], np.zeros(len(number), np.int32)), "key", None),
        ("episode", texts([e.name for e in recording.episodes], number), "key", None),
        ("step", pa.array(np.concatenate([np.arange(n, dtype=np.int32) for n in rows])), "key", None),
        ("time", pa.array(np.concatenate([e.time for e in recording.episodes])), "key", "s"),
    ]
    columns += [
        (c.name, pa.array(np.ascontiguousarray(values[:, i])), "channel", c.unit)
        for i, c in enumerate(recording.channels)
    ]
    taken = {*KEYS, *recording.names}
    for name in sorted({s for e in recording.episodes for s in e.settings} - taken):
        told = np.array([e.settings.get(name, np.nan) for e in recording.episodes])
        columns.append((name, pa.array(told[number]), "setting", None))
    fields = [
        pa.field(name, array.type, metadata={"role": role} | ({} if unit is None else {"unit": unit}))
        for name, array, role, unit in columns
    ]
    about = {
        "schema": SCHEMA,
        "channels": list(recording.names),
        "columns": {name: {"role": role, "unit": unit} for name, _, role, unit in columns},
        "episodes": [
            {"name": e.name, "rows": n, "settings": dict(e.settings)}
            for e, n in zip(recording.episodes, rows, strict=True)
        ],
        "measured": recording.measured,
        "provenance": dict(recording.provenance),
    }
    text = json.dumps(about, sort_keys=True, separators=(",", ":"))
    schema = pa.schema(fields, metadata={_KEY: text.encode()})
    return pa.Table.from_arrays([array for _, array, _, _ in columns], schema=schema)


def from_table(table: pa.Table, name: str = "table") -> Recording:
    """The recording of a table that `to_table` made, in this version or an older one; LogError for any other."""
    try:
        about = _about(table.schema)
        fields = [table.schema.field(channel) for channel in _channels(table.schema, about)]
        channels = tuple(Channel(f.name, f.metadata[b"unit"].decode()) for f in fields)
        time = table["time"].to_numpy()
        values = np.empty((table.num_rows, len(fields)))
        for i, field in enumerate(fields):
            values[:, i] = table[field.name].to_numpy()
        ends = np.cumsum([e["rows"] for e in about["episodes"]])
        if not len(ends) or ends[-1] != table.num_rows:
            raise ValueError("its rows are not those of its episodes")
        episodes = tuple(
            Episode(e["name"], time[end - e["rows"] : end], values[end - e["rows"] : end], e["settings"])
            for e, end in zip(about["episodes"], ends, strict=True)
        )
        return Recording(channels, episodes, about["measured"], about["provenance"])
    except _ODD as error:
        raise _no_recording(name, error) from error


# What a table of another origin, or one that was changed, makes of reading it.
_ODD = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)


def _no_recording(name: str, error: Exception) -> LogError:
    return LogError(
        f"{name!r} is not a stored recording: {error}",
        expected=f"a Parquet file of {SCHEMA}",
        do="ingest it as a log with `dynreg ingest`",
    )


def _about(schema: pa.Schema) -> dict[str, Any]:
    about = json.loads((schema.metadata or {})[_KEY])
    if about["schema"] not in (SCHEMA, _OLD):
        raise ValueError(f"schema {about['schema']!r}")
    return about


def _channels(schema: pa.Schema, about: Mapping[str, Any]) -> list[str]:
    """Names of the columns that are channels."""
    if about["schema"] == _OLD:
        return [name for name in schema.names if name not in ("episode", "time")]
    return about["channels"]


def is_old(path: str | Path) -> bool:
    """Whether a stored recording is of an older version; LogError where it is none."""
    import pyarrow.parquet as pq

    try:
        return _about(pq.read_schema(path))["schema"] == _OLD
    except (pa.ArrowException, OSError, *_ODD) as error:
        raise _no_recording(Path(path).name, error) from error


def to_parquet(recording: Recording) -> bytes:
    """A recording as the bytes of a Parquet file; the same recording gives the same bytes.

    Raises LimitError where it holds more numbers than `read_parquet` takes.
    """
    import pyarrow.parquet as pq

    episodes = f"a recording of {len(recording.episodes)} episodes"
    _check_size(episodes, sum(len(e.time) for e in recording.episodes) * (1 + len(recording.channels)))
    sink = BytesIO()
    pq.write_table(to_table(recording), sink, compression="zstd", compression_level=3, version="2.6")
    return sink.getvalue()


def _check_size(what: str, numbers: int) -> None:
    if numbers > limits().numbers:
        refuse(LimitError, what, f"{numbers} numbers", "numbers")


def write_parquet(recording: Recording, path: str | Path) -> None:
    """Write a recording; the same recording gives the same bytes."""
    Path(path).write_bytes(to_parquet(recording))


def read_parquet(path: str | Path) -> Recording:
    """Read what `write_parquet` wrote, bit for bit.

    Raises LogError where it is damaged or something else, LimitError where it holds more numbers than the limit allows.
    """
    import pyarrow.parquet as pq

    path = Path(path)
    try:
        with path.open("rb") as file:
            stream = pq.ParquetFile(file)
            # Which rows are whose is in the metadata: names repeated in a column could ask for any memory.
            names = ["time", *_channels(stream.schema_arrow, _about(stream.schema_arrow))]
            parts, numbers = [], 0
            for part in stream.iter_batches(
                columns=names
            ):  # the footer may tell of fewer rows than there are
                numbers += part.num_rows * len(names)
                _check_size(path.name, numbers)
                parts.append(part)
            table = pa.Table.from_batches(parts) if parts else stream.read(columns=names)
    except MemoryError:  # Arrow's own is an ArrowException, too
        raise
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(
            f"{path.name!r} cannot be read: {error}", expected="a Parquet file", do="copy it again"
        ) from error
    except _ODD as error:
        raise _no_recording(path.name, error) from error
    return from_table(table, path.name)


def to_csv(recording: Recording) -> bytes:
    """`episode`, `time`, the channels and the settings as columns: a log that needs no map."""
    from pyarrow import csv

    sink = BytesIO()
    table = to_table(recording).drop_columns(["entry", "step"]).replace_schema_metadata(None)
    table = table.set_column(0, "episode", table["episode"].cast(pa.string()))
    csv.write_csv(table, sink)
    return sink.getvalue()


def write_csv(recording: Recording, path: str | Path) -> None:
    """Write `to_csv`."""
    Path(path).write_bytes(to_csv(recording))


def to_mcap(recording: Recording) -> bytes:
    """A log of JSON messages: the channel "arm/position" is the field `position` of topic "/arm".

    Episodes lie as far apart as their times tell; one whose time begins anew follows after a pause of 1 s, and one that
    begins before the last row of the one before it, a row later. "/episode" tells where each begins, "/settings" its
    settings. A channel that would stand in one of these, or in the place of another channel, is in a topic with a "_"
    behind its name. `map_for` gives the map that reads it back (stamps are whole nanoseconds, and episodes are named by
    their number).
    """
    from mcap.writer import CompressionType, Writer

    groups = _groups(recording)
    sink = BytesIO()
    writer = Writer(sink, compression=CompressionType.ZSTD)
    writer.start(profile="", library="dynreg")
    schema = writer.register_schema("object", "jsonschema", b'{"type":"object"}')
    topics = {t: writer.register_channel(t, "json", schema) for t in (*_ABOUT, *groups)}
    for number, (episode, start) in enumerate(zip(recording.episodes, _starts(recording), strict=True)):
        base = start - episode.time[0]

        def send(topic: str, message: dict, time: float, base: float = base) -> None:
            stamp = round((base + time) * 1e9)
            writer.add_message(topics[topic], stamp, json.dumps(message).encode(), stamp)

        send("/episode", {"index": number}, episode.time[0])
        send("/settings", dict(episode.settings), episode.time[0])
        for time, row in zip(episode.time, episode.values.tolist(), strict=True):
            for topic, fields in groups.items():
                send(topic, {f: row[i] for f, i in fields.items() if np.isfinite(row[i])}, time)
    writer.finish()
    return sink.getvalue()


def _starts(recording: Recording) -> np.ndarray:
    """(E,) [s] at which episodes begin in an MCAP file: each after the last row of the one before.

    Two rows of one stamp are one row to a reader, so an episode that begins where another ends moves, and all behind
    it.
    """
    begins, times = recording.begins(_PAUSE), [e.time for e in recording.episodes]
    over = (begins + [time[-1] - time[0] for time in times])[:-1] - begins[1:]
    rows = np.array([np.median(np.diff(time)) if len(time) > 1 else _PAUSE for time in times[:-1]])
    begins[1:] += np.cumsum(np.where(over > -2 * _STAMP, over + rows, 0.0))
    return begins


def write_mcap(recording: Recording, path: str | Path) -> None:
    """Write `to_mcap`."""
    Path(path).write_bytes(to_mcap(recording))


def map_for(recording: Recording) -> LogMap:
    """The map that reads back what `write_mcap` wrote."""
    channels = recording.channels
    sources = {i: f"{t}.{f}" for t, fields in _groups(recording).items() for f, i in fields.items()}
    settings = sorted({s for e in recording.episodes for s in e.settings})
    return LogMap.model_validate(
        {
            "channels": {
                channels[i].name: {"source": s, "unit": channels[i].unit} for i, s in sources.items()
            },
            "settings": {name: {"metadata": f"/settings.{name}"} for name in settings},
            "episodes": {"by": "column", "column": "/episode.index"},
        }
    )


def _groups(recording: Recording) -> dict[str, dict[str, int]]:
    """Topics, their fields and the columns these hold; a topic whose name or field is taken gets a "_" behind it."""
    groups: dict[str, dict[str, int]] = {}
    for i, name in enumerate(recording.names):
        prefix, _, field = name.rpartition("/")
        topic, field = (f"/{prefix}", field) if prefix else (f"/{field}", "value")
        while topic in _ABOUT or field in groups.get(topic, {}):
            topic += "_"
        groups.setdefault(topic, {})[field] = i
    return groups

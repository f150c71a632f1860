"""Populations: how they are registered and grown, and which entries are missing."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import Connection, Row, select

import dynreg.registry.tables as tables
from dynreg.data.recording import Channel
from dynreg.errors import DiffersError, LimitError, RegistryError
from dynreg.limits import limits, refuse
from dynreg.registry.codec import arrays_of, encode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, sweep, unreadable
from dynreg.registry.records import COMMANDED, PopulationRecord
from dynreg.registry.robots import require_robot
from dynreg.registry.rows import require, row_of
from dynreg.registry.server import persistent
from dynreg.registry.shapes import check_spec

Span = tuple[int, int]  # numbers of entries: first, and one past the last


def put_population(directory: Directory, record: PopulationRecord) -> None:
    """Register a population, or let a known one grow to `record.size` (it never shrinks).

    Raises RegistryError when the robot is unknown or when this id holds something else.
    """
    file, data = population_file(record)
    sweep(directory.home)
    with directory.catalog.read() as connection:
        _check_same(connection, record, file.path)
    directory.stage(file, data)
    with directory.catalog.write() as writing:
        known = _check_same(writing.connection, record, file.path)
        directory.register(writing, file, data)
        row = {"id": record.id, "robot_hash": record.robot_hash, "name": record.name, "path": file.path}
        row = known._asdict() if known else row | {"size": record.size}
        writing.put(tables.populations, row | {"size": max(record.size, row["size"])})


def population_file(record: PopulationRecord) -> tuple[StoredFile, bytes]:
    """The file of what a population's entries share."""
    header = {
        "id": record.id,
        "robot": record.robot_hash,
        "name": record.name,
        "channels": [[c.name, c.unit] for c in record.channels],
        "parameters": list(record.parameters),
        "seed": record.seed,
        "spec": dict(record.spec),
        "shard_size": record.shard_size,
    }
    told = {name: [[c.name, c.unit] for c in getattr(record, name)] for name in COMMANDED}
    told["parameter_units"] = list(record.parameter_units)
    header |= {name: value for name, value in told.items() if value}
    data = encode_arrays(record.arrays, header)
    return content_name("populations", record.id[:16], data, "safetensors"), data


def get_population(directory: Directory, population_id: str) -> PopulationRecord:
    """The record of a population; NoMatchError when unknown, CorruptError when its file is damaged.

    Raises LimitError where it has more entries than the limit allows.
    """
    with directory.catalog.read() as connection:
        row = require(connection, tables.populations, population_id, "population")
    if row.size > limits().entries:
        refuse(LimitError, f"population {population_id[:12]} has too many entries", row.size, "entries")
    path = directory.locate(row.path)
    return record_of(path, arrays_of(path, directory.read_bytes(row.path)), row.size)


def record_of(path: Path, told: tuple[dict[str, Any], dict[str, np.ndarray]], size: int) -> PopulationRecord:
    """The record in a population's file (header and arrays); CorruptError where the header is none of dynreg's."""
    header, arrays = told
    kinds = {
        "id": str,
        "robot": str,
        "name": str,
        "parameters": list,
        "seed": int,
        "spec": dict,
        "shard_size": int,
    }
    try:
        odd = [name for name, kind in kinds.items() if not isinstance(header[name], kind)]
        if odd or not all(isinstance(name, str) for name in header["parameters"]):
            raise ValueError(f"its {(odd or ['parameters'])[0]!r} is of another kind")
        check_spec(header["spec"])
        return PopulationRecord(
            id=header["id"],
            robot_hash=header["robot"],
            name=header["name"],
            channels=_channels(header["channels"]),
            parameters=tuple(header["parameters"]),
            size=size,
            seed=header["seed"],
            spec=header["spec"],
            arrays=arrays,
            shard_size=header["shard_size"],
            **{group: _channels(header.get(group, [])) for group in COMMANDED},
            parameter_units=_texts(header.get("parameter_units", [])),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise unreadable(path, error) from error
    except RegistryError as error:  # the record refuses what a population cannot be
        raise unreadable(path, error.problem) from error


def _texts(told: Any) -> tuple[str, ...]:
    if not isinstance(told, list) or not all(isinstance(text, str) for text in told):
        raise ValueError(f"{told!r:.80} where names or units belong")
    return tuple(told)


def _channels(told: Any) -> tuple[Channel, ...]:
    if not isinstance(told, list):
        raise ValueError(f"{told!r:.80} where channels belong")
    return tuple(Channel(name, unit) for name, unit in map(_texts, told))


@persistent
def missing_spans(directory: Directory, population_id: str) -> tuple[Span, ...]:
    """The missing entries: spans of entry numbers, cut at multiples of the shard size.

    Shards never change, so a population that grew past a partial shard goes on behind it.
    """
    record = get_population(directory, population_id)
    with directory.catalog.read() as connection:
        held = held_spans(connection, population_id)
    spans = []
    for start, stop in gaps_between(held, 0, record.size):
        while start < stop:
            cut = min(stop, (start // record.shard_size + 1) * record.shard_size)
            spans.append((start, cut))
            start = cut
    return tuple(spans)


@contextmanager
def claim(directory: Directory, population_id: str, start: int) -> Iterator[bool]:
    """Take the span that begins at `start` for this process; False where it is taken or done.

    A killed process lets go of its claims. Claims only spare work: two writers do no harm.
    """
    with directory.claim(f"{population_id[:16]}-{start:08d}") as mine:
        yield mine and any(span[0] == start for span in missing_spans(directory, population_id))


def held_spans(connection: Connection, population_id: str) -> list[Span]:
    """Spans of the stored shards, in order."""
    table = tables.shards
    query = select(table.c.start, table.c.stop).where(table.c.population_id == population_id)
    return [(row.start, row.stop) for row in connection.execute(query.order_by(table.c.start))]


def gaps_between(held: Sequence[Span], start: int, stop: int) -> list[Span]:
    """What of `start` to `stop` none of the `held` spans (in order) covers."""
    gaps = []
    for first, last in held:
        if first > start and start < stop:
            gaps.append((start, min(first, stop)))
        start = max(start, last)
    if start < stop:
        gaps.append((start, stop))
    return gaps


def _check_same(connection: Connection, record: PopulationRecord, path: str) -> Row | None:
    """The row of this population, None where it is new."""
    require_robot(connection, record.robot_hash)
    known = row_of(connection, tables.populations, record.id)
    if known is not None and known.path != path:
        raise DiffersError(
            f"population {record.id[:12]} ({known.name!r}) is registered with other settings or arrays",
            expected="the same settings under the same id",
            do="give the new settings an id of their own",
        )
    return known

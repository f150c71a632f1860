"""Populations and their shards: planned, claimed, written, registered."""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Row, insert, select, update

from dynreg.data.recording import Channel
from dynreg.errors import NoMatchError, RegistryError
from dynreg.registry import tables
from dynreg.registry.directory import Directory
from dynreg.registry.files import (
    LOCKS,
    canonical_json,
    content_name,
    decode_arrays,
    encode_arrays,
    sweep,
    try_lock,
)
from dynreg.registry.records import PopulationRecord, ShardData
from dynreg.registry.robots import require_robot
from dynreg.registry.shards import encode_rest, encode_states

Span = tuple[int, int]  # numbers of entries: first, and one past the last


def put_population(directory: Directory, record: PopulationRecord) -> None:
    """Register a population, or let a known one grow to `record.size` (it never shrinks).

    Raises RegistryError when the robot is unknown or when this id holds something else.
    """
    data = encode_arrays(record.arrays, _header(record))
    file = content_name("populations", record.id[:16], data, "safetensors")
    directory.catalog.check_writable()
    sweep(directory.path)
    with directory.catalog.read() as connection:
        _check_same(connection, record, file.path)
    directory.stage(file, data)
    with directory.catalog.write() as connection:
        known = _check_same(connection, record, file.path)
        directory.register(connection, file, data)
        table = tables.populations
        if known is None:
            row = {"id": record.id, "robot_hash": record.robot_hash, "name": record.name}
            connection.execute(insert(table).values(**row, size=record.size, path=file.path))
        elif record.size > known.size:
            connection.execute(update(table).where(table.c.id == record.id).values(size=record.size))


def get_population(directory: Directory, population_id: str) -> PopulationRecord:
    """The record of a population; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require_population(connection, population_id)
    header, arrays = decode_arrays(directory.locate(row.path))
    return record_of(header, arrays, row.size)


def record_of(header: dict[str, Any], arrays: dict, size: int) -> PopulationRecord:
    """Put together what `put_population` took apart."""
    return PopulationRecord(
        id=header["id"],
        robot_hash=header["robot"],
        name=header["name"],
        channels=tuple(Channel(name, unit) for name, unit in header["channels"]),
        parameters=tuple(header["parameters"]),
        size=size,
        seed=header["seed"],
        spec=header["spec"],
        arrays=arrays,
        shard_size=header["shard_size"],
    )


def missing_spans(directory: Directory, population_id: str) -> tuple[Span, ...]:
    """What is left to populate: spans of entry numbers, cut at multiples of the shard size.

    Shards never change, so a population that grew past a partial shard goes on behind it.
    """
    record = get_population(directory, population_id)
    with directory.catalog.read() as connection:
        held = _held_spans(connection, population_id)
    spans = []
    for start, stop in _gaps(held, 0, record.size):
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
    directory.catalog.check_writable()
    path = directory.path / LOCKS / f"{population_id[:16]}-{start:08d}.lock"
    with try_lock(path) as mine:
        try:
            yield mine and any(span[0] == start for span in missing_spans(directory, population_id))
        finally:
            if mine:
                path.unlink(missing_ok=True)


def put_shard(directory: Directory, population_id: str, start: int, data: ShardData) -> tuple[str, ...]:
    """Store entries `start` to `start + len(data)`; returns their ids.

    What is stored already is left alone, so a second writer does no harm.

    Raises
    ------
    NoMatchError : the population is unknown.
    RegistryError : the entries reach past the population's size, do not have its shapes, or differ from
        the ones that it holds under these numbers.
    """
    record = get_population(directory, population_id)
    _check_fits(record, start, data)
    ids = data.entry_ids(population_id)
    stop = start + len(data)
    while True:
        with directory.catalog.read() as connection:
            _check_ids(connection, population_id, start, ids)
            _check_layout(connection, population_id, data)
            gaps = _gaps(_held_spans(connection, population_id), start, stop)
        if not gaps:
            return ids
        for first, last in gaps:
            part = slice(first - start, last - start)
            _put_span(directory, record, first, data.slice(part.start, part.stop), ids[part])


def _put_span(
    directory: Directory, record: PopulationRecord, start: int, data: ShardData, ids: Sequence[str]
) -> None:
    stop = start + len(data)
    header = {"population": record.id, "start": start, "stop": stop}
    stem = f"{record.id[:16]}-{start:08d}-{stop:08d}"
    rest_data, states_data = encode_rest(data, header), encode_states(data.states, record.channels, header)
    rest = content_name("shards", stem, rest_data, "safetensors")
    states = content_name("shards", stem, states_data, "parquet")
    directory.stage(rest, rest_data)
    directory.stage(states, states_data)
    with directory.catalog.write() as connection:
        if _gaps(_held_spans(connection, record.id), start, stop) != [(start, stop)]:
            return  # another process was quicker; the caller looks again
        directory.register(connection, rest, rest_data)
        directory.register(connection, states, states_data)
        insert_shard(connection, record.id, start, data, ids, (states.path, rest.path))


def insert_shard(
    connection: Connection,
    population_id: str,
    start: int,
    data: ShardData,
    ids: Sequence[str],
    paths: tuple[str, str],
) -> None:
    """The catalogue's rows of one shard and its entries; `paths` of its Parquet and safetensors files.

    Raises RegistryError as `put_shard` does.
    """
    _check_ids(connection, population_id, start, ids)
    layout = _check_layout(connection, population_id, data)
    table = tables.populations
    connection.execute(update(table).where(table.c.id == population_id).values(layout=layout))
    row = {"population_id": population_id, "start": start, "stop": start + len(data)}
    connection.execute(insert(tables.shards).values(**row, states_path=paths[0], arrays_path=paths[1]))
    connection.execute(insert(tables.entries), entry_rows(population_id, start, data, ids))


def entry_rows(population_id: str, start: int, data: ShardData, ids: Sequence[str]) -> list[dict[str, Any]]:
    """What the catalogue says of each entry of a shard (losses that are no number are left out)."""
    return [
        {
            "id": entry_id,
            "population_id": population_id,
            "number": start + i,
            "parameter_values": json.dumps(data.values[i].tolist()),
            "own_loss": _finite(data.own_loss[i]),
            "train_loss": _finite(data.train_loss[i]),
            "extra": canonical_json({name: _finite(array[i]) for name, array in data.extra.items()}),
        }
        for i, entry_id in enumerate(ids)
    ]


def require_population(connection: Connection, population_id: str) -> Row:
    """The catalogue's row of a population; NoMatchError when there is none."""
    row = _row(connection, population_id)
    if row is None:
        raise NoMatchError(
            f"no population {population_id!r}",
            expected="the id of a population of this registry",
            do="see `dynreg list`",
        )
    return row


def _row(connection: Connection, population_id: str) -> Row | None:
    return connection.execute(
        select(tables.populations).where(tables.populations.c.id == population_id)
    ).first()


def _check_same(connection: Connection, record: PopulationRecord, path: str) -> Row | None:
    """The row of this population, None where it is new."""
    require_robot(connection, record.robot_hash)
    known = _row(connection, record.id)
    if known is not None and known.path != path:
        raise RegistryError(
            f"population {record.id[:12]} ({known.name!r}) is registered with other settings or arrays",
            expected="the same settings under the same id",
            do="give the new settings an id of their own",
        )
    return known


def _header(record: PopulationRecord) -> dict[str, Any]:
    return {
        "id": record.id,
        "robot": record.robot_hash,
        "name": record.name,
        "channels": [[c.name, c.unit] for c in record.channels],
        "parameters": list(record.parameters),
        "seed": record.seed,
        "spec": dict(record.spec),
        "shard_size": record.shard_size,
    }


def _check_fits(record: PopulationRecord, start: int, data: ShardData) -> None:
    width = (data.values.shape[1], data.states.shape[3])
    planned = (len(record.parameters), len(record.channels))
    if start < 0 or start + len(data) > record.size or width != planned:
        raise RegistryError(
            f"entries {start} to {start + len(data)} with {width[0]} parameters and {width[1]} channels "
            f"do not fit population {record.id[:12]}",
            expected=f"numbers in 0 to {record.size}, {planned[0]} parameters and {planned[1]} channels",
            do="let the population grow first, or compute the shard with its settings",
        )


def _check_layout(connection: Connection, population_id: str, data: ShardData) -> str:
    """The layout of the population's entries, which must be that of `data`."""
    layout = canonical_json(data.layout)
    known = require_population(connection, population_id).layout
    if known not in (None, layout):
        raise RegistryError(
            f"a shard of shapes {layout} in population {population_id[:12]}",
            expected=f"the shapes of its other entries, {known}",
            do="compute the shard with the population's settings",
        )
    return layout


def _check_ids(connection: Connection, population_id: str, start: int, ids: Sequence[str]) -> None:
    """Each number stands for one entry, and each entry for one number."""
    table = tables.entries
    numbers = (table.c.number >= start) & (table.c.number < start + len(ids))
    rows = connection.execute(
        select(table.c.number, table.c.id).where(table.c.population_id == population_id, numbers)
    )
    held = {row.number: row.id for row in rows}
    changed = [number for number, entry in sorted(held.items()) if entry != ids[number - start]]
    if changed:
        raise RegistryError(
            f"entry {changed[0]} of population {population_id[:12]} is another one than is stored",
            expected=f"entry {held[changed[0]][:12]} under this number, not {ids[changed[0] - start][:12]}",
            do="compute it with the versions and the seed that the population was begun with",
        )
    known = dict(connection.execute(select(table.c.id, table.c.number).where(table.c.id.in_(ids))).all())
    numbered = [(entry, start + i) for i, entry in enumerate(ids)]
    twice = [(entry, n) for entry, n in numbered if known.setdefault(entry, n) != n]
    if twice:
        raise RegistryError(
            f"number {twice[0][1]} is the same entry as number {known[twice[0][0]]}: {twice[0][0][:12]}",
            expected="entries that differ in their values or their states",
            do="give every entry its own draw of the parameters",
        )


def _held_spans(connection: Connection, population_id: str) -> list[Span]:
    table = tables.shards
    query = select(table.c.start, table.c.stop).where(table.c.population_id == population_id)
    return [(row.start, row.stop) for row in connection.execute(query.order_by(table.c.start))]


def _gaps(held: Sequence[Span], start: int, stop: int) -> list[Span]:
    gaps = []
    for first, last in held:
        if first > start and start < stop:
            gaps.append((start, min(first, stop)))
        start = max(start, last)
    if start < stop:
        gaps.append((start, stop))
    return gaps


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

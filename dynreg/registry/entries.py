"""Entries into their shards: encoded, written, registered."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, select

import dynreg.registry.tables as tables
from dynreg.errors import DiffersError, RegistryError
from dynreg.registry.codec import canonical_json
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name
from dynreg.registry.populations import gaps_between, get_population, held_spans
from dynreg.registry.records import PopulationRecord, ShardData
from dynreg.registry.rows import require
from dynreg.registry.server import persistent
from dynreg.registry.shards import encode_rest, encode_rows


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
    width = (data.values.shape[1], data.states.shape[3])
    planned = (len(record.parameters), len(record.channels))
    if start < 0 or start + len(data) > record.size or width != planned:
        raise RegistryError(
            f"entries {start} to {start + len(data)} with {width[0]} parameters and {width[1]} channels "
            f"do not fit population {record.id[:12]}",
            expected=f"numbers in 0 to {record.size}, {planned[0]} parameters and {planned[1]} channels",
            do="let the population grow first, or compute the shard with its settings",
        )
    ids = data.entry_ids(population_id)
    stop = start + len(data)
    while True:
        with directory.catalog.read() as connection:
            _check_ids(connection, population_id, start, ids)
            _check_layout(connection, population_id, data)
            gaps = gaps_between(held_spans(connection, population_id), start, stop)
        if not gaps:
            return ids
        for first, last in gaps:
            part = slice(first - start, last - start)
            _put_span(directory, record, first, data.slice(part.start, part.stop), ids[part])


@persistent
def _put_span(
    directory: Directory, record: PopulationRecord, start: int, data: ShardData, ids: Sequence[str]
) -> None:
    stop = start + len(data)
    header = {"population": record.id, "start": start, "stop": stop}
    stem = _stem(record, start, data)
    rest_data = encode_rest(data, header)
    rest = content_name("shards", stem, rest_data, "safetensors")
    states, states_data = states_file(record, start, data, ids)
    directory.stage(rest, rest_data)
    directory.stage(states, states_data)
    row = {"population_id": record.id, "start": start, "stop": stop}
    row |= {"states_path": states.path, "arrays_path": rest.path}
    with directory.catalog.write() as writing:
        connection = writing.connection
        if gaps_between(held_spans(connection, record.id), start, stop) != [(start, stop)]:
            return  # another process was quicker; the caller looks again
        directory.register(writing, rest, rest_data)
        directory.register(writing, states, states_data)
        _check_ids(connection, record.id, start, ids)
        known = require(connection, tables.populations, record.id, "population")._asdict()
        writing.put(tables.populations, known | {"layout": _check_layout(connection, record.id, data)})
        writing.put(tables.shards, row)
        writing.put(tables.entries, *entry_rows(record.id, start, ids))


def states_file(
    record: PopulationRecord, start: int, data: ShardData, ids: Sequence[str]
) -> tuple[StoredFile, bytes]:
    """The Parquet file of entries `start` to `start + len(data)` of a population, with their ids."""
    encoded = encode_rows(data, record, start, ids)
    return content_name("shards", _stem(record, start, data), encoded, "parquet"), encoded


def _stem(record: PopulationRecord, start: int, data: ShardData) -> str:
    return f"{record.id[:16]}-{start:08d}-{start + len(data):08d}"


def entry_rows(population_id: str, start: int, ids: Sequence[str]) -> list[dict[str, Any]]:
    """What the catalogue says of each entry of a shard."""
    return [{"id": entry, "population_id": population_id, "number": start + i} for i, entry in enumerate(ids)]


def _check_layout(connection: Connection, population_id: str, data: ShardData) -> str:
    """The layout of the population's entries, which must be that of `data`."""
    layout = canonical_json(data.layout)
    known = require(connection, tables.populations, population_id, "population").layout
    if known not in (None, layout):
        raise DiffersError(
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
        raise DiffersError(
            f"entry {changed[0]} of population {population_id[:12]} is another one than is stored",
            expected=f"entry {held[changed[0]][:12]} under this number, not {ids[changed[0] - start][:12]}",
            do="compute it with the versions and the seed that the population was begun with",
        )
    known: dict[str, int] = {}
    for at in range(0, len(ids), tables.AT_ONCE):
        among = table.c.id.in_(ids[at : at + tables.AT_ONCE])
        known.update(connection.execute(select(table.c.id, table.c.number).where(among)).all())
    numbered = [(entry, start + i) for i, entry in enumerate(ids)]
    twice = [(entry, n) for entry, n in numbered if known.setdefault(entry, n) != n]
    if twice:
        raise DiffersError(
            f"number {twice[0][1]} is the same entry as number {known[twice[0][0]]}: {twice[0][0][:12]}",
            expected="entries that differ in their values or their states",
            do="give every entry its own draw of the parameters",
        )

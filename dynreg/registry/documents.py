"""JSON that others computed: synthesised simulators, results; and the index caches."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Connection, delete, insert, select, update

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, NoMatchError, RegistryError
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, decode_arrays, encode_arrays, strict_json
from dynreg.registry.hashes import entries_hash, ids_hash, result_id
from dynreg.registry.recordings import next_ordinal
from dynreg.registry.records import ResultRecord
from dynreg.registry.rows import require, row_of

_KIND = re.compile(r"[a-z][a-z_]*")
_KEY = re.compile(r"[A-Za-z0-9_.]+")


def put_simulator(directory: Directory, config: dict[str, Any]) -> str:
    """Store a simulator's configuration; its id is the hash of its canonical JSON."""
    file, data = _encode("simulators", "simulator", config)
    directory.stage(file, data)
    table = tables.simulators
    with directory.catalog.write() as connection:
        directory.register(connection, file, data)
        if row_of(connection, table, file.sha256) is None:
            connection.execute(insert(table).values(id=file.sha256, path=file.path))
    return file.sha256


def get_simulator(directory: Directory, simulator_id: str) -> dict[str, Any]:
    """A stored configuration; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.simulators, simulator_id, "simulator")
    return directory.read_json(row.path)


def put_result(directory: Directory, kind: str, recording_id: str, document: dict[str, Any]) -> str:
    """Store a result and return its id; it becomes the latest of its kind.

    recording_id : of the recording that it is about; "" where it is about none.
    Raises RegistryError when the kind is no plain word or the document is not plain JSON.
    """
    if not _KIND.fullmatch(kind):
        raise RegistryError(
            f"a result of kind {kind!r}", expected="a word such as 'neighbours'", do="rename it"
        )
    file, data = _encode("results", f"{kind}-{recording_id[:16]}", document)
    identity = result_id(kind, recording_id, file.sha256)
    directory.stage(file, data)
    table = tables.results
    with directory.catalog.write() as connection:
        directory.register(connection, file, data)
        ordinal = next_ordinal(connection, table)
        if row_of(connection, table, identity) is None:
            row = {"id": identity, "kind": kind, "recording_id": recording_id, "path": file.path}
            connection.execute(insert(table).values(**row, ordinal=ordinal))
        else:
            connection.execute(update(table).where(table.c.id == identity).values(ordinal=ordinal))
    return identity


def get_result(directory: Directory, identity: str) -> ResultRecord:
    """A stored result; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.results, identity, "result")
    return ResultRecord(row.id, row.kind, row.recording_id, directory.read_json(row.path))


def latest_result(directory: Directory, kind: str | None, recording_id: str | None) -> ResultRecord:
    """The result stored last, of this kind and about this recording where they are given."""
    table = tables.results_of_verbs
    query = select(table.c.id).order_by(table.c.ordinal.desc()).limit(1)
    if kind is not None:
        query = query.where(table.c.kind == kind)
    if recording_id is not None:
        query = query.where(table.c.recording_id == recording_id)
    with directory.catalog.read() as connection:
        identity = connection.execute(query).scalar()
    if identity is None:
        what = f"{kind} result" if kind else "result"
        raise NoMatchError(
            f"there is no {what} about {recording_id[:12]}" if recording_id else f"there is no last {what}",
            expected="a stored result (@last is the last one in `dynreg report`, else the last recording)",
            do="run the command that computes it, such as `dynreg query`",
        )
    return get_result(directory, identity)


def put_index(
    directory: Directory,
    population_id: str,
    key: str,
    arrays: dict[str, np.ndarray],
    entries: Sequence[str] | None = None,
) -> bool:
    """Keep what an index computed for a population under `key`, in place of what stood there.

    entries : ids of the entries that it was computed for, in the order of their numbers; without them, those
        that the population holds now, which is only safe where no other process populates.
    False where the population holds other entries by now: nothing changes then, so that an index which
    another process has put for them stays.
    """
    if not _KEY.fullmatch(key):
        raise RegistryError(
            f"an index named {key!r}", expected="letters, digits, '_' and '.'", do="rename it"
        )
    with directory.catalog.read() as connection:
        require(connection, tables.populations, population_id, "population")
        present = entries_hash(connection, population_id)
    fingerprint = present if entries is None else ids_hash(entries)
    if fingerprint != present:
        return False
    data = encode_arrays(arrays, {"population": population_id, "key": key, "entries": fingerprint})
    file = content_name("index", f"{population_id[:16]}-{key}", data, "safetensors")
    directory.stage(file, data)
    with directory.catalog.write() as connection:
        if entries_hash(connection, population_id) != fingerprint:  # they came while this was encoded
            remove_unregistered(directory, connection, file.path)
            return False
        old = drop_index(connection, population_id, key)
        directory.register(connection, file, data)
        row = {"population_id": population_id, "key": key, "entries_hash": fingerprint, "path": file.path}
        connection.execute(insert(tables.indexes).values(**row))
    if old is not None:
        with directory.catalog.write() as connection:
            remove_unregistered(directory, connection, old)
    return True


def get_index(
    directory: Directory, population_id: str, key: str, entries: Sequence[str] | None = None
) -> dict[str, np.ndarray] | None:
    """What was kept under `key`; None where there is nothing, it is stale or its file is damaged.

    entries : ids of the entries that it must have been computed for, in the order of their numbers: those that
        the caller has read. Without them, those that the population holds now.
    """
    table = tables.indexes
    with directory.catalog.read() as connection:
        require(connection, tables.populations, population_id, "population")
        query = select(table).where(table.c.population_id == population_id, table.c.key == key)
        row = connection.execute(query).first()
        wanted = entries_hash(connection, population_id) if entries is None else ids_hash(entries)
        if row is None or row.entries_hash != wanted:
            return None
        stored = row_of(connection, tables.files, row.path)
    if stored is None or not directory.holds(StoredFile(stored.path, stored.sha256, stored.size)):
        return None
    try:
        return decode_arrays(directory.locate(row.path))[1]
    except CorruptError:
        return None


def drop_index(connection: Connection, population_id: str, key: str) -> str | None:
    """Forget an index; returns the path of its file, which is the caller's to remove."""
    table = tables.indexes
    mine = (table.c.population_id == population_id) & (table.c.key == key)
    path = connection.execute(select(table.c.path).where(mine)).scalar()
    if path is not None:
        connection.execute(delete(table).where(mine))
        connection.execute(delete(tables.files).where(tables.files.c.path == path))
    return path


def remove_unregistered(directory: Directory, connection: Connection, path: str) -> None:
    """Remove a file unless the catalogue (meanwhile) knows it; inside a write transaction."""
    if row_of(connection, tables.files, path) is None:
        directory.locate(path).unlink(missing_ok=True)


def _encode(folder: str, stem: str, document: dict[str, Any]) -> tuple[StoredFile, bytes]:
    data = strict_json(document)
    return content_name(folder, stem, data, "json"), data

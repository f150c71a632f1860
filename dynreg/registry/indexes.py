"""What was computed for all entries of a population, such as a graph: kept for as long as they are the same."""

import re
from collections.abc import Sequence

import numpy as np
from sqlalchemy import Connection, delete, insert, select

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.directory import Directory
from dynreg.registry.files import StoredFile, content_name, decode_arrays, encode_arrays
from dynreg.registry.hashes import entries_hash, hash_of
from dynreg.registry.rows import require, row_of

_KEY = re.compile(r"[A-Za-z0-9_.]+")


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
    fingerprint = present if entries is None else hash_of(entries)
    if fingerprint != present:
        return False
    data = encode_arrays(arrays, {"population": population_id, "key": key, "entries": fingerprint})
    file = content_name("index", f"{population_id[:16]}-{key}", data, "safetensors")
    directory.stage(file, data)
    with directory.catalog.write() as connection:
        if entries_hash(connection, population_id) != fingerprint:  # they came while this was encoded
            _remove_unregistered(directory, connection, file.path)
            return False
        old = _drop(connection, population_id, key)
        directory.register(connection, file, data)
        row = {"population_id": population_id, "key": key, "entries_hash": fingerprint, "path": file.path}
        connection.execute(insert(tables.indexes).values(**row))
    if old is not None:
        with directory.catalog.write() as connection:
            _remove_unregistered(directory, connection, old)
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
        wanted = entries_hash(connection, population_id) if entries is None else hash_of(entries)
        if row is None or row.entries_hash != wanted:
            return None
        stored = row_of(connection, tables.files, row.path)
    if stored is None or not directory.holds(StoredFile(stored.path, stored.sha256, stored.size)):
        return None
    try:
        return decode_arrays(directory.locate(row.path))[1]
    except CorruptError:
        return None


def _drop(connection: Connection, population_id: str, key: str) -> str | None:
    """Forget an index; returns the path of its file, which is the caller's to remove."""
    table = tables.indexes
    mine = (table.c.population_id == population_id) & (table.c.key == key)
    path = connection.execute(select(table.c.path).where(mine)).scalar()
    if path is not None:
        connection.execute(delete(table).where(mine))
        connection.execute(delete(tables.files).where(tables.files.c.path == path))
    return path


def _remove_unregistered(directory: Directory, connection: Connection, path: str) -> None:
    """Remove a file unless the catalogue (meanwhile) knows it; inside a write transaction."""
    if row_of(connection, tables.files, path) is None:
        directory.locate(path).unlink(missing_ok=True)

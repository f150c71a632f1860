"""Hashes over what a registry holds."""

import hashlib
from collections.abc import Iterable

from sqlalchemy import Connection, select

import dynreg.registry.tables as tables


def entries_hash(connection: Connection, population_id: str) -> str:
    """Hash over the ids of a population's entries in the order of their numbers."""
    table = tables.entries
    query = select(table.c.id).where(table.c.population_id == population_id).order_by(table.c.number)
    return ids_hash(connection.execute(query).scalars())


def ids_hash(ids: Iterable[str]) -> str:
    """Hash over ids of entries, in the order of their numbers: equal to `entries_hash` of their population."""
    return _hash(ids)


def catalog_hash(connection: Connection) -> str:
    """Hash over all entries and recordings: equal for two registries that hold the same ones."""
    found = [f"entry {i}" for i in connection.execute(select(tables.entries.c.id)).scalars()]
    found += [f"recording {i}" for i in connection.execute(select(tables.recordings.c.id)).scalars()]
    return _hash(sorted(found))


def result_id(kind: str, recording_id: str, document_sha256: str) -> str:
    """Id of a result: what it is, what it is about, what it says."""
    return _hash([kind, recording_id, document_sha256])


def _hash(lines: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for line in lines:
        digest.update(f"{line}\n".encode())
    return digest.hexdigest()

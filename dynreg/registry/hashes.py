"""Hashes over what a registry holds."""

import hashlib
from collections.abc import Iterable

from sqlalchemy import Connection, select

import dynreg.registry.tables as tables


def entries_hash(connection: Connection, population_id: str) -> str:
    """Hash over the ids of a population's entries in the order of their numbers."""
    table = tables.entries
    query = select(table.c.id).where(table.c.population_id == population_id).order_by(table.c.number)
    return hash_of(connection.execute(query).scalars())


def hashes_of_first(ids: Iterable[str]) -> dict[str, int]:
    """{`hash_of` the first so many ids: how many}, for every number of them."""
    known, digest = {}, hashlib.sha256()
    for count, line in enumerate(ids, start=1):
        digest.update(f"{line}\n".encode())
        known[digest.hexdigest()] = count
    return known


def result_id(kind: str, recording_id: str, document_sha256: str) -> str:
    """Id of a result: what it is, what it is about, what it says."""
    return hash_of([kind, recording_id, document_sha256])


def hash_of(lines: Iterable[str]) -> str:
    """Hash over lines; over ids of entries, in the order of their numbers, it is `entries_hash` of their population."""
    digest = hashlib.sha256()
    for line in lines:
        digest.update(f"{line}\n".encode())
    return digest.hexdigest()

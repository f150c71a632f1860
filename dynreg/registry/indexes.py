"""Computed indexes, in files of their own that name their entries; the catalogue does not know them."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.codec import arrays_of, encode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.files import INDEX, content_hash, content_name, read_regular, unreadable
from dynreg.registry.hashes import entries_hash, hash_of, hashes_of_first
from dynreg.registry.rows import require

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
    False where the population holds other entries by now: an index that another process has put for them stays.
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
    file = content_name(INDEX, f"{population_id[:16]}-{key}", data, "safetensors")
    directory.stage(file, data)
    with directory.catalog.read() as connection:
        present = entries_hash(connection, population_id)
    if present != fingerprint:  # others came while this was encoded
        directory.remove([file.path])
        return False
    directory.remove(name for name in _names(directory, population_id, key) if name != file.path)
    return True


def get_index(
    directory: Directory, population_id: str, key: str, entries: Sequence[str] | None = None
) -> dict[str, np.ndarray] | None:
    """What was kept under `key`; None where there is nothing, it is stale or its file is damaged.

    entries : ids of the entries that it must have been computed for, in the order of their numbers: those that
        the caller has read. Without them, those that the population holds now.
    """
    with directory.catalog.read() as connection:
        require(connection, tables.populations, population_id, "population")
        wanted = entries_hash(connection, population_id) if entries is None else hash_of(entries)
    return next((a for h, a in _sound(directory, population_id, key) if h["entries"] == wanted), None)


def get_grown(
    directory: Directory, population_id: str, key: str, entries: Sequence[str]
) -> tuple[int, dict[str, np.ndarray]] | None:
    """What was kept under `key` for the first of these entries, and for how many; None where there is no such thing.

    entries : ids in the order of their numbers: a population that grew has more than its index was computed for.
    """
    known = hashes_of_first(entries)
    found = [
        (known[h["entries"]], a) for h, a in _sound(directory, population_id, key) if h["entries"] in known
    ]
    return max(found, key=lambda one: one[0], default=None)


def _sound(
    directory: Directory, population_id: str, key: str
) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Header and arrays of what is kept for a population under `key`; damaged files are passed over."""
    for name in _names(directory, population_id, key):
        try:
            header, arrays = read_index(directory.brought(name))
        except CorruptError:
            continue
        if (header["population"], header["key"]) == (population_id, key):
            yield header, arrays


def read_index(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of an index's file; CorruptError where its bytes do not fit the hash in its name."""
    try:
        data = read_regular(path)
    except OSError as error:
        raise unreadable(path, error) from error
    if not path.stem.endswith(f"-{content_hash(data)[:16]}"):
        raise unreadable(path, "its bytes do not fit the hash in its name")
    header, arrays = arrays_of(path, data)
    if not {"population", "key", "entries"} <= header.keys():
        raise unreadable(path, "it does not say what it was computed for")
    return header, arrays


def _names(directory: Directory, population_id: str, key: str) -> list[str]:
    begins = f"{INDEX}/{population_id[:16]}-{key}-"
    return [n for n in directory.names(INDEX) if n.startswith(begins) and n.endswith(".safetensors")]

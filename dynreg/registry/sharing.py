"""Shared registries: a local folder whose marker says where the catalogue and the files lie.

The folder is the registry's local face: it holds the marker, copies of what was read or written here, caches, and
journals of searches. It may be removed and made again without loss. No password and no key is in it.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dynreg.registry.disk as disk
from dynreg.errors import RegistryError, command
from dynreg.registry.bucket import Bucket
from dynreg.registry.directory import Directory
from dynreg.registry.files import CACHE, FOLDERS, LEDGER, LOCKS, is_content, read_regular, write_file
from dynreg.registry.ledger import page_name
from dynreg.registry.seal import lost_tables
from dynreg.registry.served import ServedCatalog
from dynreg.registry.server import address
from dynreg.registry.tables import metadata
from dynreg.registry.writing import Writing

MARKER = "dynreg.json"
FORMAT = "dynreg-registry"
PARTS = "parts"  # of files in the bucket of which not all was fetched
VERSION = 3  # of a marker that names a catalogue and a bucket
_BYTES = 4000  # a marker has some 200


@dataclass(frozen=True)
class Shared:
    """Where a shared registry lies.

    catalog : an SQLAlchemy URL of a PostgreSQL database, without a password. blobs : the address of a bucket and a
    prefix in it, without a key.
    """

    catalog: str
    blobs: str


def read_marker(path: Path) -> dict[str, Any] | None:
    """What the marker of a registry at `path` says; None where there is none. OSError where it cannot be read."""
    try:
        marker = json.loads(read_regular(path / MARKER, _BYTES))
        return marker if marker["format"] == FORMAT and int(marker["version"]) else None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def shared_at(path: Path) -> Shared | None:
    """Where the registry at `path` lies, if it is a shared one; RegistryError where its marker does not say that."""
    try:
        marker = read_marker(path)
    except OSError:
        return None
    if marker is None or int(marker["version"]) != VERSION:
        return None
    told = marker.get("catalog"), marker.get("blobs")
    if not all(isinstance(one, str) for one in told):
        raise RegistryError(
            f"the marker {str(path / MARKER)!r} does not say where the registry lies",
            expected="a catalogue and a bucket",
            do="remove the folder, and make it again with `dynreg init`",
        )
    return Shared(*told)


def share(path: Path, told: Shared, lost: bool = False) -> None:
    """Make `path` the local face of the registry at these addresses; the registry itself where they hold none yet.

    lost : whether its catalogue is lost, so that an empty database is to take its place.

    The addresses are looked at first. Raises UsageError for odd ones, RegistryError where they cannot be reached,
    `path` is something else already, or catalogue and bucket are not of the same registry.
    """
    address(told.catalog)
    bucket = Bucket(told.blobs)
    known = shared_at(path)
    if known is None and _is_registry(path):
        raise RegistryError(
            f"{str(path)!r} is a registry in one folder",
            expected="an empty place for a new folder",
            do=f"name another one with --registry, and then `{command('import', path)}` there brings it along",
        )
    if known not in (None, told) or (known is None and _is_taken(path)):
        raise RegistryError(
            f"{str(path)!r} is {'a face of another registry' if known else 'something else already'}",
            expected="an empty place for a new folder",
            do="name another one with --registry",
        )
    bucket.check()
    catalog = ServedCatalog(told.catalog, bucket, migrate=not lost)
    try:
        _check_pair(catalog, bucket, lost)
    finally:
        catalog.close()
    disk.make_folder(path.absolute())
    marker = {"format": FORMAT, "version": VERSION, "catalog": told.catalog, "blobs": told.blobs}
    write_file(path / MARKER, json.dumps(marker).encode() + b"\n")


def _check_pair(catalog: ServedCatalog, bucket: Bucket, lost: bool) -> None:
    """RegistryError where the bucket lacks the last page that the catalogue names, or holds some and it names none.

    Of a `lost` catalogue the bucket must hold something, and the database that takes its place nothing.
    """
    with catalog.read() as connection:
        nothing = lost and len(lost_tables(connection)) == len(metadata.tables)
        number, sha256 = (0, "") if nothing else Writing(connection).last_page()
    pages, where = bucket.names(LEDGER), bucket.uri.partition("?")[0]
    if lost and (number or not (pages or bucket.names(""))):
        raise RegistryError(
            f"the database holds the catalogue of {'another' if pages else 'a'} registry"
            if number
            else f"the bucket {where!r} holds nothing from which a catalogue could be written",
            expected="an empty database, and the bucket whose catalogue is lost",
            do="give another --catalog: an empty database" if number else "name the --blobs of that registry",
        )
    if not number and pages and not lost:
        raise RegistryError(
            f"the bucket {where!r} holds a registry whose catalogue is another one",
            expected="the catalogue that belongs to it, or an empty prefix",
            do="name another --catalog or --blobs; where that catalogue is lost, add --rebuild, which writes it anew",
        )
    if number and page_name(number, sha256) not in pages:
        raise RegistryError(
            f"the bucket {where!r} does not hold the files of the registry in this catalogue",
            expected="the bucket and the prefix with which the registry was made",
            do="name its --blobs, or give a --catalog that is empty",
        )


def open_shared(path: Path, told: Shared, migrate: bool = True) -> Directory:
    """Open a shared registry by its local folder; raises as `ServedCatalog`, and where the bucket is not reached.

    migrate : False leaves its catalogue as it is, whatever that lacks.
    """
    for name in (*FOLDERS, LOCKS):
        disk.make_folder(path / name)
    bucket = Bucket(told.blobs, kept=path / CACHE / PARTS)
    return Directory(path, ServedCatalog(told.catalog, bucket, migrate), bucket=bucket)


def _is_registry(path: Path) -> bool:
    """Whether an ordinary registry lies there."""
    try:
        return read_marker(path) is not None
    except OSError:
        return False


def _is_taken(path: Path) -> bool:
    return path.exists() and (not path.is_dir() or any(is_content(p.name) for p in path.iterdir()))

"""Hands on what a registry keeps, past dynreg: its files and its rows, in a folder or on servers."""

import hashlib
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from dynreg.registry import Registry
from dynreg.registry.files import CACHE, FOLDERS
from dynreg.registry.mirroring import bring_all, send_back
from dynreg.registry.sharing import PARTS
from dynreg.registry.tables import metadata


@contextmanager
def files_of(registry: Registry) -> Iterator[Path]:
    """The folder of the stored files, to be changed; what lies here of a shared registry goes, as on a new machine."""
    bucket = registry.directory.bucket
    if bucket is None:
        yield registry.path
        return
    with TemporaryDirectory() as place:
        brought = bring_all(bucket, Path(place), {})
        yield Path(place)
        send_back(bucket, Path(place), brought)
    shutil.rmtree(registry.path / CACHE / PARTS, ignore_errors=True)
    for name in FOLDERS:
        shutil.rmtree(registry.path / name, ignore_errors=True)
        (registry.path / name).mkdir()


def sql(registry: Registry, statement: str) -> None:
    """Change the catalogue from outside."""
    if registry.directory.bucket is None:
        connection = sqlite3.connect(registry.path / "catalog.sqlite")
        with connection:
            changed = connection.execute(statement).rowcount
        connection.close()
    else:
        changed = _served(registry, statement)
    assert changed > 0, "the damage changed nothing"


def lose_catalogue(registry: Registry, how: str = "delete") -> None:
    """Close a registry, and lose its catalogue; how : "delete", or "overwrite" what is in its place."""
    bucket = registry.directory.bucket
    if bucket is not None:
        tables = ", ".join(metadata.tables if how == "delete" else ["entries"])
        _served(registry, f"DROP TABLE {tables} CASCADE")
    registry.close()
    if bucket is None and how == "delete":
        (registry.path / "catalog.sqlite").unlink()
    elif bucket is None:
        told = b"not a database, but long enough to be taken for one" * 100
        (registry.path / "catalog.sqlite").write_bytes(told)


def stored(registry: Registry) -> dict[str, str]:
    """SHA-256 of every stored file by its name; of a folder the catalogue's, too."""
    bucket = registry.directory.bucket
    if bucket is not None:
        told = registry.directory.catalog.last_page()
        return {n: hashlib.sha256(bucket.read(n)).hexdigest() for n in bucket.names("")} | {"page": str(told)}
    passing = ("-wal", "-shm", "-journal", ".lock")
    files = (p for p in registry.path.rglob("*") if p.is_file() and not p.name.endswith(passing))
    return {
        p.relative_to(registry.path).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files
    }


def _served(registry: Registry, statement: str) -> int:
    import psycopg

    url = registry.directory.catalog.url
    address = {"host": url.host, "port": url.port, "user": url.username, "dbname": url.database}
    with psycopg.connect(**address) as connection:
        connection.execute("SET session_replication_role = replica")  # no row keeps another one
        return connection.execute(statement).rowcount

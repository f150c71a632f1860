"""Hands on what a registry keeps, past dynreg: its files and its rows, in a folder or on servers."""

import hashlib
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from sqlalchemy import Connection, create_engine, make_url

from dynreg.registry.bucket import Bucket
from dynreg.registry.files import CACHE, FOLDERS
from dynreg.registry.mirroring import bring_all, send_back
from dynreg.registry.sharing import PARTS, shared_at
from dynreg.registry.tables import metadata


def bucket_of(path: Path) -> Bucket | None:
    """Where the files of a shared registry lie; None of one in a folder."""
    told = shared_at(path)
    return None if told is None else Bucket(told.blobs)


@contextmanager
def files_of(path: Path) -> Iterator[Path]:
    """The folder of the stored files, to be changed; what lies here of a shared registry goes, as on a new machine."""
    bucket = bucket_of(path)
    if bucket is None:
        yield path
        return
    with TemporaryDirectory() as place:
        brought = bring_all(bucket, Path(place), {})
        yield Path(place)
        send_back(bucket, Path(place), brought)
    forget_here(path)


def forget_here(path: Path) -> None:
    """Remove what lies here of a shared registry's files."""
    shutil.rmtree(path / CACHE / PARTS, ignore_errors=True)
    for name in FOLDERS:
        shutil.rmtree(path / name, ignore_errors=True)
        (path / name).mkdir()


def row_number(path: Path) -> str:
    """The column by which the database itself tells one row of a table from another."""
    return "rowid" if shared_at(path) is None else "ctid"


def sql(path: Path, *statements: str) -> None:
    """Change the catalogue from outside."""
    if shared_at(path) is None:
        connection = sqlite3.connect(path / "catalog.sqlite")
        with connection:
            changed = [connection.execute(statement).rowcount for statement in statements]
        connection.close()
    else:
        changed = _served(path, statements)
    assert all(changed), "the damage changed nothing"


@contextmanager
def catalogue(path: Path) -> Iterator[Connection]:
    """A transaction on the catalogue that dynreg knows nothing of."""
    told = shared_at(path)
    url = f"sqlite:///{path / 'catalog.sqlite'}" if told is None else told.catalog
    engine = create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        yield connection
    engine.dispose()


def lose_catalogue(path: Path, how: str = "delete") -> None:
    """Lose the catalogue of a registry that nobody has open; how : "delete", or "overwrite" what is in its place."""
    if shared_at(path) is not None:
        tables = ", ".join(metadata.tables if how == "delete" else ["entries"])
        _served(path, [f"DROP TABLE {tables} CASCADE"])
    elif how == "delete":
        (path / "catalog.sqlite").unlink()
    else:
        told = b"not a database, but long enough to be taken for one" * 100
        (path / "catalog.sqlite").write_bytes(told)


def stored(path: Path) -> dict[str, str]:
    """SHA-256 of every stored file by its name; of a folder the catalogue's, too."""
    bucket = bucket_of(path)
    if bucket is not None:
        with catalogue(path) as connection:
            told = connection.exec_driver_sql("SELECT * FROM seals ORDER BY name").all()
        return {n: hashlib.sha256(bucket.read(n)).hexdigest() for n in bucket.names("")} | {"page": str(told)}
    passing = ("-wal", "-shm", "-journal", ".lock")
    files = (p for p in path.rglob("*") if p.is_file() and not p.name.endswith(passing))
    return {p.relative_to(path).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def _served(path: Path, statements: tuple[str, ...] | list[str]) -> list[int]:
    import psycopg

    url = make_url(shared_at(path).catalog)
    address = {"host": url.host, "port": url.port, "user": url.username, "dbname": url.database}
    with psycopg.connect(**address) as connection:
        connection.execute("SET session_replication_role = replica")  # no row keeps another one
        return [connection.execute(statement).rowcount for statement in statements]

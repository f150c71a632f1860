"""The catalogue: one SQLite file, opened so that several processes may read and write at once."""

import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

import dynreg.registry.migrations as migrations
from dynreg.errors import CorruptError, DynregError, RegistryError

FILE = "catalog.sqlite"
BUSY_SECONDS = 60.0


class Catalog:
    """Transactions on `catalog.sqlite`; migrates an older one when it is opened.

    Raises RegistryError (newer version, locked, read-only) and CorruptError (not a sound database).
    """

    def __init__(self, folder: Path):
        self.path = folder / FILE
        self.writable = os.access(folder, os.W_OK)
        self._engine = _engine(self.path, self.writable)
        try:
            with self.read() as connection:
                names = migrations.pending(connection)
            if names:
                with self.write() as connection:
                    migrations.apply(connection, migrations.pending(connection))
        except DynregError:
            self.close()
            raise

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """One consistent view of the catalogue."""
        with self._transaction("BEGIN") as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """One transaction that holds the write lock from its start; rolled back on any error."""
        self.check_writable()
        with self._transaction("BEGIN IMMEDIATE") as connection:
            yield connection

    def check_writable(self) -> None:
        """RegistryError where the registry can only be read."""
        if not self.writable:
            raise RegistryError(
                f"the registry {str(self.path.parent)!r} is read-only",
                expected="a directory that may be written",
                do="copy it to a place of your own, or mend its permissions",
            )

    def close(self) -> None:
        """Let go of the file; the write-ahead log is folded in by the last one who leaves."""
        self._engine.dispose()

    @contextmanager
    def _transaction(self, begin: str) -> Iterator[Connection]:
        try:
            with self._engine.connect() as connection:
                connection.execution_options(dynreg_begin=begin)
                with connection.begin():
                    yield connection
        except (DBAPIError, sqlite3.Error) as error:
            raise _explained(self.path, str(getattr(error, "orig", error))) from error


def _engine(path: Path, writable: bool) -> Engine:
    def connect() -> sqlite3.Connection:
        # Without write access SQLite cannot keep its shared memory file; with nothing in the write-ahead log
        # the database may be read as one that never changes.
        log = path.with_name(path.name + "-wal")
        mode = "rwc" if writable else "ro" if log.exists() and log.stat().st_size else "ro&immutable=1"
        return sqlite3.connect(
            f"{path.absolute().as_uri()}?mode={mode}",
            uri=True,
            timeout=BUSY_SECONDS,
            isolation_level=None,
            check_same_thread=False,
        )

    engine = create_engine("sqlite://", creator=connect, poolclass=NullPool)

    @event.listens_for(engine, "connect")
    def _settings(connection: sqlite3.Connection, record: object) -> None:
        if writable:
            _use_write_ahead_log(connection)
            connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")
        connection.execute("PRAGMA trusted_schema=OFF")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(connection.get_execution_options().get("dynreg_begin", "BEGIN"))

    return engine


def _use_write_ahead_log(connection: sqlite3.Connection) -> None:
    # The change of mode does not wait for other processes as a transaction does.
    for _ in range(100):
        try:
            if connection.execute("PRAGMA journal_mode").fetchone()[0] != "wal":
                connection.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error):
                raise
            time.sleep(0.05)


def _explained(path: Path, cause: str) -> RegistryError:
    if "locked" in cause or "busy" in cause:
        return RegistryError(
            f"the catalogue {str(path)!r} stayed locked for {BUSY_SECONDS:.0f} s",
            expected="short transactions of other processes",
            do="wait for the other dynreg processes, or end the one that hangs",
        )
    if "readonly" in cause or "unable to open" in cause or "full" in cause:
        return RegistryError(
            f"the catalogue {str(path)!r} cannot be written: {cause}",
            expected="a writable directory with room left",
            do="mend its permissions or free some space, then run the same command again",
        )
    return CorruptError(
        f"the catalogue {str(path)!r} is damaged: {cause}",
        expected="a sound SQLite database",
        do="restore it from a copy, or run `dynreg verify --repair` to rebuild it from the stored files",
    )

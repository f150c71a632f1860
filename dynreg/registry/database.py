"""SQLite as the catalogue uses it: how a connection is made, and what its errors mean."""

import sqlite3
import time
from pathlib import Path

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.pool import NullPool

from dynreg.errors import CorruptError, NoPlaceError, RegistryError

BUSY_SECONDS = 60.0
_LONGEST = 1 << 26  # bytes of one value: the manifest of a robot with some 500,000 files

_NO_PLACE = {"SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM", "SQLITE_AUTH"}
_LOCKED = {"SQLITE_BUSY", "SQLITE_LOCKED", "SQLITE_PROTOCOL"}
_REFUSED = {
    "SQLITE_TOOBIG",
    "SQLITE_MISMATCH",
    "SQLITE_MISUSE",
    "SQLITE_RANGE",
    "SQLITE_INTERRUPT",
    "SQLITE_ABORT",
}
_CUT_SHORT = "SQLITE_IOERR_SHORT_READ"  # the file ends before it should: damage, and not the disk's


def engine_for(path: Path, create: bool = False) -> Engine:
    """Connections to the database at `path`, which is made with `create` alone; each transaction has its own."""

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(
            f"{path.absolute().as_uri()}?mode={'rwc' if create else 'rw'}",
            uri=True,
            timeout=BUSY_SECONDS,
            isolation_level=None,
            check_same_thread=False,
        )

    engine = create_engine("sqlite://", creator=connect, poolclass=NullPool)

    @event.listens_for(engine, "connect")
    def _settings(connection: sqlite3.Connection, record: object) -> None:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
        connection.execute("PRAGMA trusted_schema=OFF")  # before anything of the file is read
        _use_write_ahead_log(connection)
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(connection.get_execution_options().get("dynreg_begin", "BEGIN"))

    return engine


def explained(path: Path, error: Exception) -> RegistryError:
    """The meaning of an error of SQLite (or of SQLAlchemy about one) for the catalogue at `path`, by SQLite's own code.

    Only a damaged file is a CorruptError: a full or failing disk, a lock and a lack of rights leave it as it is.
    """
    cause = getattr(error, "orig", None) or error
    name = getattr(cause, "sqlite_errorname", "") or ""
    kind = "_".join(name.split("_")[:2])
    if kind in _LOCKED:
        return NoPlaceError(
            f"the catalogue {str(path)!r} stayed locked for {BUSY_SECONDS:.0f} s",
            expected="short transactions of other processes",
            do="wait for the other dynreg processes, or end the one that hangs",
        )
    if kind in _NO_PLACE:
        return NoPlaceError(
            f"the catalogue {str(path)!r} cannot be opened or written: {cause} ({name})",
            expected="a directory and a catalogue that may be written",
            do="mend their permissions, then run the same command again",
        )
    if kind in _REFUSED:
        return NoPlaceError(
            f"SQLite refused to work on the catalogue {str(path)!r}: {cause} ({name})",
            expected="values of a usual size, and a dynreg and a SQLite that fit each other",
            do="run the same command again with --debug, and tell what it says",
        )
    if kind in ("SQLITE_FULL", "SQLITE_IOERR", "SQLITE_NOMEM") and name != _CUT_SHORT:
        return NoPlaceError(
            f"the disk or the memory failed under the catalogue {str(path)!r}: {cause} ({name})",
            expected="room for a few MB more, and a disk that reads and writes",
            do="free some space or check the disk, then run the same command again",
        )
    return CorruptError(
        f"the catalogue {str(path)!r} is damaged: {cause}" + (f" ({name})" if name else ""),
        expected="a sound SQLite database",
        do="restore it from a copy, or run `dynreg verify --repair` to rebuild it from the ledger and the stored files",
    )


def _use_write_ahead_log(connection: sqlite3.Connection) -> None:
    # The change of mode does not wait for other processes as a transaction does.
    for _ in range(100):
        try:
            if connection.execute("PRAGMA journal_mode").fetchone()[0] != "wal":
                connection.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorname", "").split("_")[1:2] not in (["BUSY"], ["LOCKED"]):
                raise
            time.sleep(0.05)

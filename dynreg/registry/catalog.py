"""The catalogue: one SQLite file, opened so that several processes may read and write at once.

It follows the ledger, page by page, and is compared with its own seals whenever its file has changed.
"""

import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, RootTransaction
from sqlalchemy.exc import DBAPIError

import dynreg.registry.disk as disk
import dynreg.registry.migrations as migrations
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, Damaged
from dynreg.registry.database import engine_for, explained
from dynreg.registry.files import LEDGER
from dynreg.registry.ledger import Page, last_number, pages_after, read_page, write_page
from dynreg.registry.seal import broken_seals, broken_structure, rows_in, strange_objects
from dynreg.registry.tables import Values
from dynreg.registry.writing import Writing

FILE = "catalog.sqlite"
BESIDE = (f"{FILE}-wal", f"{FILE}-shm", f"{FILE}-journal")  # files that SQLite keeps beside it

State = tuple[tuple[int, int, int] | None, ...]
_SOUND: dict[Path, State] = {}  # what this process has compared with its seals, as long as it stays so


class Catalog:
    """Transactions on `catalog.sqlite` in `folder`, which migrate an older one and follow the ledger beside it.

    shown : the folder that errors name, where it is another one. migrate : False leaves an older one as it is.

    Raises RegistryError (newer version, locked, no room) and CorruptError (not a sound database, changed from outside).
    """

    def __init__(self, folder: Path, *, shown: Path | None = None, migrate: bool = True):
        self.path = folder.absolute() / FILE
        self.shown = (shown or folder) / FILE
        self._engine = engine_for(self.path, create=not self.path.exists())
        if not migrate:
            return
        try:
            self.migrate()
        except BaseException:
            self.close()
            raise
        self._engine = engine_for(self.path)

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """One consistent view of the catalogue, compared with its seals where its file has changed since the last.

        Raises CorruptError where it is not as dynreg left it.
        """
        state = self._state()
        if state != _SOUND.get(self.path) and pages_after(self.path.parent, self.last_page()):
            with self.write():
                state = self._state()
        with self.transaction("BEGIN") as connection:
            self._check(connection, state)
            yield connection

    @contextmanager
    def write(self) -> Iterator[Writing]:
        """One transaction that holds the write lock from its start; rolled back on any error.

        What it puts is on a page of the ledger before it is in the catalogue. Raises CorruptError as `read` does.
        """
        with self.transaction("BEGIN IMMEDIATE") as connection:
            state = self._state()
            self._check(connection, state)
            writing = Writing(connection)
            self._follow(writing)
            yield writing
            if writing.changed:
                page = writing.page()
                writing.enter(page.number, write_page(self.path.parent, page))
        _SOUND[self.path] = self._state()  # it was sound, and this transaction alone has changed it

    def close(self) -> None:
        """Let go of the file; the write-ahead log is folded in by the last one who leaves."""
        self._engine.dispose()

    def migrate(self) -> None:
        """Bring an older catalogue up to date; what one without a ledger holds becomes the ledger's first page."""
        with self.transaction("BEGIN") as connection:
            strange = strange_objects(connection, migrations.known_tables())
            if strange:
                raise self._changed(f"it holds {strange[0]}")
            names = _of_tables(migrations.pending(connection))
        if not names:
            return
        with self.transaction("BEGIN IMMEDIATE") as connection:
            names = _of_tables(migrations.pending(connection))  # another process may have been quicker
            migrations.apply(connection, names)
            if migrations.LEDGER in names:
                disk.make_folder(self.path.parent / LEDGER)
                rows = rows_of(connection)
                odd = [m for t in tables.HELD for row in rows[t.name] if (m := tables.misfit(t, row))]
                if odd:
                    raise self._changed(odd[0])
                if any(rows.values()):
                    self.begin_anew(Writing(connection), rows)

    def begin_anew(self, writing: Writing, rows: dict[str, list[Values]], after: int = 0) -> None:
        """Put these rows in place of all that the catalogue holds, and begin its ledger anew with them.

        after : number of a page that the new one has to come after, beside those in the ledger's folder.
        """
        number = max(after, writing.last_page()[0], last_number(self.path.parent)) + 1
        page = Page(number, put={name: tuple(values) for name, values in rows.items()}, whole=True)
        writing.follow(page, write_page(self.path.parent, page))

    @contextmanager
    def transaction(self, begin: str) -> Iterator[Connection]:
        """A transaction without any check; errors of SQLite become those of dynreg by their codes."""
        try:
            connection, transaction = self._begun(begin)
            with connection, transaction:
                yield connection
        except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:
            raise explained(self.shown, error) from error

    def _begun(self, begin: str) -> tuple[Connection, RootTransaction]:
        """A connection in a transaction on the file that has the name now: a repair may have replaced it meanwhile."""
        while True:
            identity = identity_of(self.path)
            connection = self._engine.connect().execution_options(dynreg_begin=begin)
            try:
                transaction = connection.begin()
            except BaseException:
                connection.close()
                raise
            if identity is None or identity == identity_of(self.path):
                return connection, transaction
            connection.close()

    def _check(self, connection: Connection, state: State) -> None:
        if state == _SOUND.get(self.path):
            return
        faults = broken_structure(connection) or broken_seals(connection)
        if faults:
            raise self._changed(faults[0])
        last, root = Writing(connection).last_page()[0], self.path.parent
        if last and not pages_after(root, last - 1) and root == self.shown.parent.absolute():
            text = (
                f"the ledger of {str(self.shown.parent)!r} lacks its last page; run `dynreg verify --repair`"
            )
            warnings.warn(text, Damaged, 2)
        _SOUND[self.path] = state

    def _changed(self, fault: str) -> CorruptError:
        return CorruptError(
            f"the catalogue {str(self.shown)!r} was changed from outside: {fault}",
            expected="the rows that dynreg wrote",
            do="run `dynreg verify --repair` to write it again from the ledger and the stored files",
        )

    def last_page(self) -> int:
        """Number of the last page of the ledger that the catalogue holds; 0 where it holds none."""
        with self.transaction("BEGIN") as connection:
            return Writing(connection).last_page()[0]

    def _follow(self, writing: Writing) -> None:
        """Take over the pages of puts that were cut short after their page was written."""
        number, before = writing.last_page()
        later = pages_after(self.path.parent, number)
        if later:  # whoever wrote them may have been cut short before their names were synced
            disk.sync_folder(self.path.parent / LEDGER)
        for path in later:
            try:
                page, sha256 = read_page(path)
                if not page.whole and (page.number, page.before) != (number + 1, before):
                    raise ValueError(f"it does not follow page {number}")
            except (OSError, ValueError) as error:
                raise CorruptError(
                    f"the page {path.name!r} of the ledger cannot be used: {error}",
                    expected="the next page, as it was written",
                    do="run `dynreg verify --repair` to see what is lost and what can be rebuilt",
                ) from error
            writing.follow(page, sha256)
            number, before = page.number, sha256

    def _state(self) -> State:
        """What changes when the catalogue or its ledger does: identities of their files.

        A log without a byte counts as none: SQLite makes one for whoever looks, and removes it with the last of them.
        """
        root = self.path.parent
        catalog, log, ledger = (identity_of(p) for p in (self.path, root / BESIDE[0], root / LEDGER))
        return catalog, log if log and log[1] else None, ledger


def _of_tables(names: list[str]) -> list[str]:
    return [name for name in names if name != migrations.FILES]


def identity_of(path: Path) -> tuple[int, int, int] | None:
    """What changes when a file does; None where there is none."""
    try:
        told = path.stat()
    except OSError:
        return None
    return told.st_ino, told.st_size, told.st_mtime_ns


def rows_of(connection: Connection) -> dict[str, list[Values]]:
    """All rows that the catalogue holds, by table."""
    return rows_in(connection, tables.HELD)

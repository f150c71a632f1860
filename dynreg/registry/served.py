"""The catalogue on a server that many machines share; its ledger lies in the bucket beside the other files.

The catalogue decides what is stored. The page of a put is in the bucket before the put is committed, so that the
catalogue can be written again from the pages; a page that the catalogue does not name is that of a put which was cut
short before anybody was told of it.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from sqlalchemy import ColumnElement, Connection, func, select
from sqlalchemy.exc import DBAPIError

import dynreg.registry.migrations as migrations
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, Interrupted
from dynreg.registry.bucket import Bucket
from dynreg.registry.ledger import Page, encode_page
from dynreg.registry.seal import lost_tables
from dynreg.registry.server import address, engine_for, explained, persistent, shown
from dynreg.registry.tables import Values
from dynreg.registry.writing import Writing


class ServedCatalog:
    """Transactions on the catalogue at `url`, whose tables are made where there are none.

    migrate : False leaves it as it is.

    Readers see one moment and wait for nobody. Writers take turns. Its rows are guarded by the server's rights and
    checksums: their seals are compared by `verify`, and not at every look.

    Raises RegistryError (newer version, not reached, refused, locked) and CorruptError (its tables are damaged).
    """

    def __init__(self, url: str, bucket: Bucket, migrate: bool = True):
        self.url = address(url)
        self.bucket = bucket
        self._engine = engine_for(self.url)
        self._answered = False  # whether the server was there before
        if not migrate:
            return
        try:
            self.migrate()
        except BaseException:
            self.close()
            raise

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """One consistent view of the catalogue."""
        with self.transaction("BEGIN") as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Writing]:
        """One transaction that holds the write lock from its start; rolled back on any error.

        What it puts is on a page of the ledger before it is in the catalogue.
        """
        with self.transaction("BEGIN IMMEDIATE") as connection:
            writing = Writing(connection)
            yield writing
            if writing.changed:
                page = writing.page()
                writing.enter(page.number, self._keep(page))

    def close(self) -> None:
        """Let go of the connections."""
        self._engine.dispose()

    def migrate(self) -> None:
        """Make the tables of a new catalogue, or bring an older one up to date; CorruptError where some are lost."""
        with self.transaction("BEGIN") as connection:
            lost = lost_tables(connection)
            if not lost and not migrations.pending(connection):
                return
        with self.transaction("BEGIN IMMEDIATE") as connection:  # another process may have been quicker
            lost, pending = lost_tables(connection), migrations.pending(connection)
            if len(lost) == len(tables.metadata.tables):
                tables.metadata.create_all(connection)
                connection.execute(tables.migrations.insert(), [{"name": name} for name in migrations.STEPS])
            elif lost and not pending:
                raise CorruptError(
                    f"the catalogue {shown(self.url)!r} lacks the table {lost[0]!r}",
                    expected="the tables that dynreg made",
                    do="restore it from a backup, or run `dynreg verify --repair`, which writes it from the ledger",
                )
            elif pending:
                migrations.apply(connection, pending)

    def last_page(self) -> int:
        """Number of the last page of the ledger that the catalogue holds; 0 where it holds none."""
        with self.transaction("BEGIN") as connection:
            return Writing(connection).last_page()[0]

    def begin_anew(self, writing: Writing, rows: dict[str, list[Values]], after: int = 0) -> None:
        """Put these rows in place of all that the catalogue holds, and begin its ledger anew with them.

        after : number of a page that the new one has to come after, beside those that the catalogue holds.
        """
        number = max(after, writing.last_page()[0]) + 1
        page = Page(number, put={name: tuple(values) for name, values in rows.items()}, whole=True)
        writing.follow(page, self._keep(page))

    @contextmanager
    def transaction(self, begin: str) -> Iterator[Connection]:
        """A transaction without any check; errors of PostgreSQL become those of dynreg by their codes.

        A server that was there before is waited for (`server.persistent`).
        """
        connection = self._connected(dynreg_begin=begin)
        try:
            with connection, connection.get_transaction():
                yield connection
        except DBAPIError as error:
            raise explained(self.url, error) from error

    @contextmanager
    def claim(self, name: str) -> Iterator[bool]:
        """Hold the lock of a name for the block; False where another process holds it.

        It is the session's, so the server lets go of it when the process or its machine is gone. Where the session
        ends during the block, as when the server starts anew, another process may take it: two writers do no harm.
        """
        key = func.hashtextextended(func.concat("dynreg claim ", func.current_schema(), " ", name), 0)
        with self._connected(isolation_level="AUTOCOMMIT") as connection:
            mine = self._told(connection, func.pg_try_advisory_lock(key))
            try:
                yield mine
            finally:
                if mine:
                    with suppress(Interrupted):
                        self._told(connection, func.pg_advisory_unlock(key))

    def _told(self, connection: Connection, what: ColumnElement) -> Any:
        try:
            return connection.execute(select(what)).scalar_one()
        except DBAPIError as error:
            raise explained(self.url, error) from error

    def _connected(self, **options: str) -> Connection:
        """A connection in a transaction; NoPlaceError where the server stays away."""

        def connect() -> Connection:
            connection = None
            try:
                connection = self._engine.connect().execution_options(**options)
                connection.begin()
                return connection
            except DBAPIError as error:
                if connection is not None:
                    connection.close()
                raise explained(self.url, error) from error

        connection = (persistent(connect) if self._answered else connect)()
        self._answered = True
        return connection

    def _keep(self, page: Page) -> str:
        file, data = encode_page(page)
        self.bucket.write(file.path, data)
        return file.sha256

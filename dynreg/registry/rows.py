"""One row of the catalogue by its key."""

from sqlalchemy import Connection, Row, Table, select

from dynreg.errors import CorruptError, NoMatchError
from dynreg.registry.tables import misfit


def row_of(connection: Connection, table: Table, identity: str) -> Row | None:
    """The row whose key (the first column of it) is `identity`; CorruptError for one that dynreg cannot have written.

    No look at a catalogue on a server compares its rows with their seals, so each is looked at where it is used.
    """
    key = next(iter(table.primary_key))
    row = connection.execute(select(table).where(key == identity)).first()
    if row is not None and (problem := misfit(table, tuple(row))):
        raise CorruptError(
            f"the catalogue was changed from outside: {problem}",
            expected="the rows that dynreg wrote",
            do="run `dynreg verify --repair` to write it again from the ledger and the stored files",
        )
    return row


def require(
    connection: Connection, table: Table, identity: str, noun: str, do: str = "see `dynreg list`"
) -> Row:
    """The row of what a noun means; NoMatchError when there is none, CorruptError as `row_of`."""
    row = row_of(connection, table, identity)
    if row is None:
        raise NoMatchError(f"no {noun} {identity!r}", expected=f"the id of a stored {noun}", do=do)
    return row

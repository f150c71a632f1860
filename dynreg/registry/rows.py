"""One row of the catalogue by its key."""

from sqlalchemy import Connection, Row, Table, select

from dynreg.errors import NoMatchError


def row_of(connection: Connection, table: Table, identity: str) -> Row | None:
    """The row whose key (the first column of it) is `identity`."""
    key = next(iter(table.primary_key))
    return connection.execute(select(table).where(key == identity)).first()


def require(
    connection: Connection, table: Table, identity: str, noun: str, do: str = "see `dynreg list`"
) -> Row:
    """The row of what a noun means; NoMatchError when there is none."""
    row = row_of(connection, table, identity)
    if row is None:
        raise NoMatchError(f"no {noun} {identity!r}", expected=f"the id of a stored {noun}", do=do)
    return row

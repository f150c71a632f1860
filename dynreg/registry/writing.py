"""Rows put into the catalogue inside one transaction, noted for the page of the ledger and for the seals."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, and_, delete, func, insert, select, tuple_, update

import dynreg.registry.tables as tables
from dynreg.registry.ledger import Page
from dynreg.registry.seal import Seal, read_seals, write_seals
from dynreg.registry.tables import Key, Values, key_of, named, values_of


class Writing:
    """One transaction that writes: `connection` to read by, `put` and `remove` to write by."""

    def __init__(self, connection: Connection):
        self.connection = connection
        self._put: dict[str, dict[Key, Values]] = {}
        self._removed: dict[str, dict[Key, None]] = {}
        self._seals: dict[str, Seal] = {}
        self._known = read_seals(connection)

    @property
    def changed(self) -> bool:
        """Whether anything that the ledger holds was written."""
        return bool(self._put or self._removed)

    def put(self, table: Table, *rows: Mapping[str, Any]) -> None:
        """Write rows; a row takes the place of one with the same key, and one that is there already changes nothing."""
        new = {key_of(table, values): values for values in (values_of(table, row) for row in rows)}
        held = self._held(table, list(new))
        added = [values for key, values in new.items() if key not in held]
        changed = [values for key, values in new.items() if key in held and held[key] != values]
        if added:
            self.connection.execute(insert(table), [named(table, values) for values in added])
        for values in changed:
            row = named(table, values)
            self.connection.execute(update(table).where(_is(table, key_of(table, values))).values(**row))
        gone = [held[key_of(table, values)] for values in changed]
        self._note(table, added + changed, gone)

    def remove(self, table: Table, *keys: Key) -> None:
        """Take out the rows of these keys, those that are there."""
        held = self._held(table, keys)
        for key in held:
            self.connection.execute(delete(table).where(_is(table, key)))
            self._put.get(table.name, {}).pop(key, None)
            self._removed.setdefault(table.name, {})[key] = None
        self._note(table, (), list(held.values()))

    def follow(self, page: Page, sha256: str) -> None:
        """Do what a page of the ledger says, and note that the catalogue holds it."""
        if page.whole:  # the table of pages, too: `enter` begins it again
            for table in reversed(tables.SEALED):
                self.connection.execute(delete(table))
                self._seals[table.name] = Seal()
        for table in tables.HELD:
            self.put(table, *(named(table, values) for values in page.put.get(table.name, ())))
        for table in reversed(
            tables.HELD
        ):  # what is removed may have been referred to by a row that was put anew
            self.remove(table, *page.removed.get(table.name, ()))
        self.enter(page.number, sha256)

    def page(self) -> Page:
        """The page that tells what was written."""
        number, before = self.last_page()
        put = {name: tuple(rows.values()) for name, rows in self._put.items() if rows}
        removed = {name: tuple(keys) for name, keys in self._removed.items() if keys}
        return Page(number + 1, before, put, removed)

    def last_page(self) -> tuple[int, str]:
        """Number and sha256 of the last page that the catalogue holds; (0, "") where it holds none."""
        query = select(tables.pages).order_by(tables.pages.c.number.desc()).limit(1)
        row = self.connection.execute(query).first()
        return (row.number, row.sha256) if row else (0, "")

    def enter(self, number: int, sha256: str) -> None:
        """Note that the catalogue holds a page, and write the seals of all tables that have changed."""
        values = (number, sha256)
        self.connection.execute(insert(tables.pages), [named(tables.pages, values)])
        self._note(tables.pages, [values], ())
        write_seals(self.connection, self._seals)
        self._put, self._removed = {}, {}

    def last_ordinal(self, table: Table, identity: str) -> int:
        """The ordinal that makes a row the last of its table: its own where it is that already."""
        key = next(iter(table.primary_key))
        highest = self.connection.execute(select(func.max(table.c.ordinal))).scalar() or 0
        own = self.connection.execute(select(table.c.ordinal).where(key == identity)).scalar()
        return highest if own == highest and own else highest + 1

    def _held(self, table: Table, keys: Sequence[Key]) -> dict[Key, Values]:
        columns, found = list(table.primary_key), {}
        for at in range(0, len(keys), tables.AT_ONCE // len(columns)):
            some = keys[at : at + tables.AT_ONCE // len(columns)]
            among = columns[0].in_([k[0] for k in some]) if len(columns) == 1 else tuple_(*columns).in_(some)
            rows = map(tuple, self.connection.execute(select(table).where(among)))
            found.update((key_of(table, values), values) for values in rows)
        return found

    def _note(self, table: Table, came: Iterable[Values], went: Iterable[Values]) -> None:
        came, went = list(came), list(went)
        if not came and not went:
            return
        before = self._seals.get(table.name, self._known[table.name])
        self._seals[table.name] = before.with_rows(came, went)
        if table in tables.HELD:
            for values in came:
                key = key_of(table, values)
                self._put.setdefault(table.name, {})[key] = values
                self._removed.get(table.name, {}).pop(key, None)


def _is(table: Table, key: Key) -> ColumnElement[bool]:
    return and_(*(column == value for column, value in zip(table.primary_key, key, strict=True)))

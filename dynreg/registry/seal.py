"""A seal over each table of the catalogue: a change that dynreg did not make is seen when the table is read.

The sum of the rows' hashes does not depend on their order, so that a transaction changes it by its own rows alone
(Bellare and Micciancio, "A New Paradigm for Collision-free Hashing", 1997: AdHash).
"""

import hashlib
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, Table, delete, insert, inspect, select, text

import dynreg.registry.tables as tables

_MODULUS = 1 << 256


@dataclass(frozen=True)
class Seal:
    """How many rows a table has, and the sum of their hashes modulo 2^256."""

    rows: int = 0
    digest: int = 0

    def with_rows(self, added: Iterable[Sequence], removed: Iterable[Sequence] = ()) -> "Seal":
        """The seal when these rows (values in the order of the table's columns) come and go."""
        came, went = [_hash(row) for row in added], [_hash(row) for row in removed]
        return Seal(
            self.rows + len(came) - len(went),
            (self.digest + sum(came) - sum(went)) % _MODULUS,
        )


def read_seals(connection: Connection) -> dict[str, Seal]:
    """{name of a table: its seal as it was written}; the seal of nothing where there is none."""
    rows = connection.execute(select(tables.seals)).all()
    written = {row.name: _written(row.rows, row.digest) for row in rows}
    return {table.name: written.get(table.name, Seal()) for table in tables.SEALED}


def write_seals(connection: Connection, seals: Mapping[str, Seal]) -> None:
    """Put seals in place of those that were written for the same tables."""
    if seals:
        connection.execute(delete(tables.seals).where(tables.seals.c.name.in_(list(seals))))
        rows = [{"name": n, "rows": seal.rows, "digest": f"{seal.digest:064x}"} for n, seal in seals.items()]
        connection.execute(insert(tables.seals), rows)


def broken_structure(
    connection: Connection, known: Collection[str] = tuple(tables.metadata.tables)
) -> list[str]:
    """What shows that the catalogue is no sound database of the `known` tables, a line each; empty where it is."""
    if connection.dialect.name == "postgresql":
        return [f"the table {name!r} is missing" for name in lost_tables(connection)]
    strange = strange_objects(connection, known)
    if strange:
        return [f"it holds {name}" for name in strange]
    return [row[0] for row in connection.execute(text("PRAGMA integrity_check")) if row[0] != "ok"]


def lost_tables(connection: Connection) -> list[str]:
    """Names of the tables that a catalogue on a server lacks; what else it holds is not dynreg's to judge."""
    told = (
        "SELECT table_name, table_type FROM information_schema.tables WHERE table_schema = current_schema()"
    )
    kinds = dict(connection.execute(text(told)).all())
    return [name for name in tables.metadata.tables if kinds.get(name) != "BASE TABLE"]


def drop_views(connection: Connection, names: Iterable[str]) -> None:
    """Remove views of a catalogue on a server that have the names of tables which it lacks."""
    views = set(inspect(connection).get_view_names())
    for name in views.intersection(names):
        connection.execute(text(f'DROP VIEW "{name}" CASCADE'))


def broken_seals(connection: Connection) -> list[str]:
    """What shows that rows are not as dynreg left them, a line for each table; empty where they are."""
    seals, broken = read_seals(connection), []
    for name, rows in rows_in(connection, tables.SEALED).items():
        table = tables.metadata.tables[name]
        if Seal().with_rows(rows) != seals[name]:
            broken.append(f"the table {name!r} is not as dynreg left it")
        broken += [problem for row in rows if (problem := tables.misfit(table, row))][:1]
    return broken


def rows_in(connection: Connection, some: Iterable[Table]) -> dict[str, list[tuple]]:
    """All rows of these tables, by name; none of a table that an older catalogue lacks."""
    there = set(inspect(connection).get_table_names())
    return {t.name: [*map(tuple, connection.execute(select(t)))] if t.name in there else [] for t in some}


def strange_objects(connection: Connection, known: Collection[str]) -> list[str]:
    """Views, triggers and tables of a catalogue that are none of the `known` tables."""
    rows = connection.execute(text("SELECT type, name, rootpage, sql FROM sqlite_master")).all()
    plain = [  # a virtual table has no page of its own, a generated column computes what is read
        (
            row.type == "table"
            and row.name in known
            and row.rootpage
            and "GENERATED" not in (row.sql or "").upper()
        )
        or (row.type == "index" and row.sql is None)  # SQLite's own, of keys
        for row in rows
    ]
    return [f"the {row.type} {row.name!r}" for row, is_plain in zip(rows, plain, strict=True) if not is_plain]


def _written(rows: object, digest: object) -> Seal:
    try:
        return Seal(int(rows), int(digest, 16))
    except (TypeError, ValueError, OverflowError):
        return Seal(-1)  # no table has it


def _hash(row: Sequence) -> int:
    text = json.dumps(list(row), default=repr)  # ASCII; bytes are none of dynreg's and only have to differ
    return int.from_bytes(hashlib.sha256(text.encode()).digest(), "big")

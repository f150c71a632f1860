"""An examination of a registry: its catalogue and its ledger are compared, then both with its files."""

import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select
from sqlalchemy.exc import DBAPIError

import dynreg.registry.migrations as migrations
import dynreg.registry.server as server
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.catalog import FILE, Catalog, rows_of
from dynreg.registry.comparing import Fault, VerifyReport, compare, differing_rows
from dynreg.registry.database import explained
from dynreg.registry.directory import Directory
from dynreg.registry.files import INDEX, LEDGER, ROBOTS
from dynreg.registry.ledger import Ledger, pages_after, read_ledger, removed_files, replay
from dynreg.registry.opening import beside, lost_catalog, may_write
from dynreg.registry.rebuild import Rows
from dynreg.registry.scan import Found, scan
from dynreg.registry.seal import broken_seals, broken_structure
from dynreg.registry.served import ServedCatalog
from dynreg.registry.tables import Key, Values, key_of, misfit, named, values_of


@dataclass(frozen=True)
class Stored:
    """What the file of the catalogue holds.

    rows, pages : by table; sha256 by the number of a page. faults : why it is not as dynreg left it.
    catalog, connection : for writing to it; None where its file has to be written anew. ledger : where its ledger lies.
    usable : whether it is a sound database, whatever its rows say. has_ledger : False of one of format 1.
    """

    rows: Rows = field(default_factory=lambda: {table.name: [] for table in tables.HELD})
    pages: Mapping[int, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    catalog: Catalog | ServedCatalog | None = None
    connection: Connection | None = None
    ledger: Path | None = None
    usable: bool = False
    has_ledger: bool = True


@dataclass(frozen=True)
class Examined:
    """The stored things, as far as they are known, and the faults.

    held : the rows that were put. found : what the files hold. faulty : faults of the catalogue and of the ledger.
    bad_pages : files of the ledger that cannot be used. behind : whether the ledger is ahead of the catalogue.
    rows_lost : whether pages of the ledger are lost, so that a row may be.
    removed : files of a removal that was cut short after its page was written; they are none of the registry's.
    """

    held: Rows
    found: Found
    faulty: tuple[Fault, ...]
    bad_pages: tuple[str, ...]
    behind: bool
    rows_lost: bool
    removed: tuple[str, ...]
    report: VerifyReport


@contextmanager
def stored_in(path: Path, begin: str) -> Iterator[Stored]:
    """What the catalogue holds, inside a transaction on it where it can be read; RegistryError where its disk fails."""
    if lost_catalog(path) or not (path / FILE).exists():
        yield Stored(faults=("it is missing or empty",) if lost_catalog(path) else ())
        return
    try:
        opened = Directory(path, Catalog(path, migrate=False)) if may_write(path) else beside(path)
    except CorruptError as error:
        yield Stored(faults=(error.problem,))
        return
    with ExitStack() as stack:
        stack.callback(opened.close)
        stored = Stored()
        try:
            with ExitStack() as reading:
                connection = reading.enter_context(opened.catalog.transaction(begin))
                stored = _read(connection, partial(explained, path / FILE))
                if stored.usable:
                    stored = replace(stored, catalog=opened.catalog, connection=connection)
                    stack.push(reading.pop_all())  # the transaction stays
        except CorruptError as error:  # its end may meet the damage, too
            stored = replace(stored, faults=stored.faults or (error.problem,))
        yield replace(stored, ledger=opened.home)


def read_served(place: Path, catalog: ServedCatalog, connection: Connection) -> Stored:
    """What a catalogue on a server holds, inside a transaction on it; copies of its files lie in `place`."""
    stored = _read(connection, partial(server.explained, catalog.url))
    return replace(stored, catalog=catalog, connection=connection, ledger=place)


def _read(connection: Connection, told: Callable[[Exception], RegistryError]) -> Stored:
    """told : the meaning of an error of the database."""
    try:
        if set(migrations.pending(connection)) == set(migrations.STEPS):
            return Stored()  # its creation was cut short
        broken = broken_structure(connection, migrations.known_tables())
        rows = _named(rows_of(connection))
        if migrations.LEDGER in migrations.pending(connection):  # nothing is sealed, and no page tells of it
            rows["files"] = [row for row in rows["files"] if not row["path"].startswith(f"{INDEX}/")]
            return Stored(rows, faults=tuple(broken), has_ledger=False)
        pages = dict(connection.execute(select(tables.pages.c.number, tables.pages.c.sha256)).all())
        return Stored(rows, pages, tuple(broken or broken_seals(connection)), usable=not broken)
    except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:
        problem = told(error)
        if not isinstance(problem, CorruptError):
            raise problem from error
        return Stored(faults=(problem.problem,))


def examine(path: Path, stored: Stored) -> Examined:
    """Compare catalogue and ledger with each other, then what they tell with the files."""
    root = path if stored.ledger is None or pages_after(path, 0) else stored.ledger
    ledger = read_ledger(root)
    pages = _page_faults(stored, ledger) if stored.has_ledger else {}
    faults = [Fault("catalog", FILE, reason, lost=bool(pages)) for reason in stored.faults]
    if not stored.has_ledger:
        held = stored.rows
    elif pages and _follows_all(stored, ledger):  # it tells, too, what the lost pages took out
        held = stored.rows
    elif pages:  # what the catalogue holds, and beside it what the pages tell that are left
        both = {n: rows | keyed(stored.rows)[n] for n, rows in keyed(_told(ledger)).items()}
        held = {name: list(rows.values()) for name, rows in both.items()}
    else:
        held = _told(ledger)
        if not stored.faults or stored.connection is not None:
            followed = _told(ledger, max(stored.pages, default=0))
            faults = list(differing_rows(keyed(stored.rows), keyed(followed))) or faults
    faults += [Fault("ledger", what, why, lost=bool(stored.faults)) for what, why in sorted(pages.items())]
    odd = {t.name: [row for row in held[t.name] if misfit(t, values_of(t, row))] for t in tables.HELD}
    faults += [
        Fault("row", f"{name} {next(iter(row.values()))!s:.24}", "not a row of dynreg's", lost=True)
        for name, rows in odd.items()
        for row in rows
    ]
    held = {name: [row for row in rows if row not in odd[name]] for name, rows in held.items()}
    removed = _removed(held, ledger)
    found = scan(path, {row["path"] for row in held["files"]}, removed)
    behind = any(page.number > max(stored.pages, default=0) for page, _ in ledger.pages)
    report = compare(held, found, faults)
    return Examined(held, found, tuple(faults), tuple(ledger.bad), behind, bool(pages), removed, report)


def _follows_all(stored: Stored, ledger: Ledger) -> bool:
    """Whether a sound catalogue has followed every page that is left."""
    return not stored.faults and all(stored.pages.get(page.number) == sha for page, sha in ledger.pages)


def _removed(held: Rows, ledger: Ledger) -> tuple[str, ...]:
    """Files that pages took out and no row names."""
    named = {row["path"] for row in held["files"]} | {f"{ROBOTS}/{row['hash']}/" for row in held["robots"]}
    return tuple(sorted(removed_files(page for page, _ in ledger.pages) - named))


def _page_faults(stored: Stored, ledger: Ledger) -> dict[str, str]:
    """Pages that are damaged, and pages that the catalogue follows and that are gone: why, by their names."""
    if not ledger.pages and not ledger.bad and stored.faults:
        return {LEDGER: "it has no page"}
    present = {page.number: sha256 for page, sha256 in ledger.pages}
    begins = min(present, default=0)
    missing = sorted(n for n, sha256 in stored.pages.items() if n >= begins and present.get(n) != sha256)
    more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
    lost = {f"{LEDGER}/{number:08d}": f"it is missing{more}" for number in missing[:1]}
    return lost | dict(ledger.bad)  # of a number that two pages have, the ledger says more


def _told(ledger: Ledger, last: int | None = None) -> Rows:
    """The rows that the pages leave, up to the page of the number `last`."""
    pages = [page for page, _ in ledger.pages if last is None or page.number <= last]
    return _named({name: rows.values() for name, rows in replay(pages).items()})


def keyed(rows: Rows) -> dict[str, dict[Key, dict[str, Any]]]:
    """The rows of each table by their keys."""
    return {t.name: {key_of(t, values_of(t, row)): row for row in rows[t.name]} for t in tables.HELD}


def _named(rows: Mapping[str, Iterable[Values]]) -> Rows:
    return {t.name: [named(t, values) for values in rows[t.name]] for t in tables.HELD}

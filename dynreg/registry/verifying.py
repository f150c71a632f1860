"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

import secrets
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from sqlalchemy import Connection, select
from sqlalchemy.exc import DBAPIError

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.catalog import BESIDE, FILE, Catalog, rows_of
from dynreg.registry.comparing import Fault, VerifyReport, compare, differing_rows
from dynreg.registry.database import explained
from dynreg.registry.directory import (
    Directory,
    beside,
    check_links,
    check_marker,
    lost_catalog,
    make_folders,
    may_write,
)
from dynreg.registry.files import (
    CACHE,
    INDEX,
    LEDGER,
    LOST_AND_FOUND,
    ROBOTS,
    sweep,
    temporary_folder,
    write_file,
)
from dynreg.registry.ledger import Ledger, Page, Values, pages_after, read_ledger, replay
from dynreg.registry.rebuild import Rows, new_rows, unknown_files
from dynreg.registry.scan import Found, scan
from dynreg.registry.seal import broken_seals, broken_structure
from dynreg.registry.writing import Writing

_SPARE = 8 << 20  # bytes that a repair asks for, beside three times the catalogue and the ledger


def verify(path: Path, repair: bool = False, dry_run: bool = False) -> VerifyReport:
    """Compare catalogue, ledger and files of the registry at `path`, hash by hash and row by row.

    With `repair` catalogue and ledger are brought in line with the files: lost entries are taken out, so that a
    populate computes them again; sound files that no row knows are adopted; all other strange files are moved to
    `lost+found/`; a damaged catalogue is written anew beside the old one and takes its place at the end. Populations
    and robots that lost their own files stay, to be healed by putting them again. Other writers wait meanwhile. With
    `dry_run` nothing is changed, and the faults say what a repair would do.

    Raises RegistryError when there is no registry at `path`, a part of it is a link, or its disk is full, fails or may
    not be written for a repair: nothing is changed then.
    """
    path = Path(path)
    check_marker(path)
    check_links(path)
    if dry_run or not repair:
        with _stored(path, "BEGIN") as stored:
            report = _examine(path, stored).report
        return _with_words(report, "would be ") if dry_run else report
    if not may_write(path):
        raise RegistryError(f"{str(path)!r} is read-only", expected="a writable registry", do="copy it first")
    _check_room(path)
    make_folders(path)
    with _stored(path, "BEGIN IMMEDIATE") as stored:
        examined = _examine(path, stored)
        rows = new_rows(path, examined.held, examined.found)
        changed = bool(examined.faulty) or _keyed(rows) != _keyed(examined.held)
        if changed and stored.connection is not None:
            stored.catalog.begin_anew(Writing(stored.connection), _values(rows))
    if changed and stored.connection is None:
        _rebuild(path, _values(rows))
    _put_away(path, [*unknown_files(rows, examined.found), *examined.ledger.bad])
    sweep(path)
    return _with_words(examined.report)


@dataclass(frozen=True)
class _Stored:
    """What the file of the catalogue holds.

    rows, pages : by table; sha256 by the number of a page. faults : why it is not as dynreg left it.
    catalog, connection : for writing to it; None where its file has to be written anew. ledger : where its ledger lies.
    usable : whether it is a sound database, whatever its rows say.
    """

    rows: Rows = field(default_factory=lambda: {table.name: [] for table in tables.HELD})
    pages: Mapping[int, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    catalog: Catalog | None = None
    connection: Connection | None = None
    ledger: Path | None = None
    usable: bool = False


@dataclass(frozen=True)
class _Examined:
    """What was put, as far as it can be told; what the files hold; and what is at fault in catalogue or ledger."""

    held: Rows
    found: Found
    ledger: Ledger
    faulty: tuple[Fault, ...]
    report: VerifyReport


@contextmanager
def _stored(path: Path, begin: str) -> Iterator[_Stored]:
    """What the catalogue holds, inside a transaction on it where it can be read; RegistryError where its disk fails."""
    if lost_catalog(path) or not (path / FILE).exists():
        yield _Stored(faults=("it is missing or empty",) if lost_catalog(path) else ())
        return
    try:
        opened = Directory(path, Catalog(path)) if may_write(path) else beside(path)
    except CorruptError as error:
        yield _Stored(faults=(error.problem,))
        return
    with ExitStack() as stack:
        stack.callback(opened.close)
        stored = _Stored()
        try:
            with ExitStack() as reading:
                connection = reading.enter_context(opened.catalog.transaction(begin))
                stored = _read(path, connection)
                if stored.usable:
                    stored = replace(stored, catalog=opened.catalog, connection=connection)
                    stack.push(reading.pop_all())  # the transaction stays
        except CorruptError as error:  # its end may meet the damage, too
            stored = replace(stored, faults=stored.faults or (error.problem,))
        yield replace(stored, ledger=opened.home)


def _read(path: Path, connection: Connection) -> _Stored:
    try:
        broken = broken_structure(connection)
        rows = {
            name: [dict(zip(tables.metadata.tables[name].c.keys(), row, strict=True)) for row in rows]
            for name, rows in rows_of(connection).items()
        }
        pages = dict(connection.execute(select(tables.pages.c.number, tables.pages.c.sha256)).all())
        return _Stored(rows, pages, tuple(broken or broken_seals(connection)), usable=not broken)
    except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:
        problem = explained(path / FILE, error)
        if not isinstance(problem, CorruptError):
            raise problem from error
        return _Stored(faults=(problem.problem,))


def _examine(path: Path, stored: _Stored) -> _Examined:
    """Compare catalogue and ledger with each other, then what they tell with the files."""
    root = path if stored.ledger is None or pages_after(path, 0) else stored.ledger
    ledger = read_ledger(root)
    gone = _ledger_faults(stored, ledger)
    told = _rows([page for page, _ in ledger.pages])
    faults = [Fault("catalog", FILE, reason, lost=bool(gone)) for reason in stored.faults]
    if not gone:
        held = told
        if not stored.faults or stored.connection is not None:
            last = max(stored.pages, default=0)
            differing = list(
                differing_rows(stored.rows, _rows([p for p, _ in ledger.pages if p.number <= last]))
            )
            faults = differing or faults
    elif not stored.faults:
        held = stored.rows
    else:
        known = _keyed(told)
        rest = {n: [r for r in rows if _key(n, r) not in known[n]] for n, rows in stored.rows.items()}
        held = {name: told[name] + rest[name] for name in told}
    faulty = tuple(
        Fault("ledger", what, reason, lost=bool(stored.faults)) for what, reason in sorted(gone.items())
    )
    found = scan(path, {row["path"] for row in held["files"]})
    return _Examined(held, found, ledger, (*faults, *faulty), compare(held, found, [*faults, *faulty]))


def _ledger_faults(stored: _Stored, ledger: Ledger) -> dict[str, str]:
    """Pages that are damaged, and pages that the catalogue follows and that are gone, by their names."""
    present = {page.number: sha256 for page, sha256 in ledger.pages}
    begins = min(present, default=0)
    gone = [n for n, sha256 in stored.pages.items() if n >= begins and present.get(n) != sha256]
    return dict(ledger.bad) | (
        {f"{LEDGER}/{min(gone):08d}": f"{len(gone)} pages are missing"} if gone else {}
    )


def _rows(pages: list[Page]) -> Rows:
    return {
        name: [dict(zip(tables.metadata.tables[name].c.keys(), row, strict=True)) for row in rows.values()]
        for name, rows in replay(pages).items()
    }


def _values(rows: Rows) -> dict[str, list[Values]]:
    return {t.name: [tuple(row[c.name] for c in t.c) for row in rows[t.name]] for t in tables.HELD}


def _key(name: str, row: dict) -> tuple:
    return tuple(row[column.name] for column in tables.metadata.tables[name].primary_key)


def _keyed(rows: Rows) -> dict[str, dict[tuple, dict]]:
    return {name: {_key(name, row): row for row in held} for name, held in rows.items()}


def _rebuild(path: Path, rows: dict[str, list[Values]]) -> None:
    """A new catalogue and the page that it follows, made beside the old ones; they take their places at the end."""
    with temporary_folder(path / FILE) as place:
        make_folders(place)
        catalog = Catalog(place)
        try:
            with catalog.transaction("BEGIN IMMEDIATE") as connection:
                after = max((int(page.name.split("-")[0]) for page in pages_after(path, 0)), default=0)
                catalog.begin_anew(Writing(connection), rows, after)
        finally:
            catalog.close()
        for page in pages_after(place, 0):
            disk.rename(page, path / LEDGER / page.name)
        disk.sync_folder(path / LEDGER)
        # The old log first: SQLite would play it into the new catalogue.
        _put_away(path, [name for name in (*BESIDE, FILE) if (path / name).exists()])
        disk.rename(place / FILE, path / FILE)
        disk.sync_folder(path)


def _check_room(path: Path) -> None:
    """Ask for the room that a repair may need, before it touches anything; RegistryError where there is none."""
    sizes = [p.stat().st_size for p in (path / FILE, path / BESIDE[0], *pages_after(path, 0)) if p.exists()]
    probe = path / ".room.tmp-probe"
    try:
        write_file(probe, bytes(_SPARE + 3 * sum(sizes)))
    finally:
        probe.unlink(missing_ok=True)


_MENDED = {
    "catalog": "written anew from the ledger and the stored files",
    "ledger": "begun anew from what is held",
    "shard": "taken out of the catalogue; a populate computes it again",
    "entries": "rows written anew from the shard",
    "recording": "taken out of the catalogue; ingest its log again",
    "simulator": "taken out of the catalogue",
    "result": "taken out of the catalogue; the command that made it computes it again",
    "index": "dropped; it is computed again when it is needed",
    "cache": "dropped; it is computed again when it is needed",
    "search": f"moved to {LOST_AND_FOUND}/; the search begins anew",
    "row": "written anew from what was put, or taken out",
    "stray": f"moved to {LOST_AND_FOUND}/",
}


def _with_words(report: VerifyReport, before: str = "") -> VerifyReport:
    """The report with what a repair does to each fault, or `before` it what it would."""
    said = {kind: before + text for kind, text in _MENDED.items()}
    return replace(report, faults=tuple(replace(f, mended=said.get(f.kind)) for f in report.faults))


def _put_away(root: Path, names: list[str]) -> None:
    """Move files out of the way, to `lost+found/`; files of indexes, which are computed again, are removed."""
    place = root / LOST_AND_FOUND
    for name in names:
        source = root / name
        if name.split("/")[0] in (INDEX, CACHE) and not source.is_symlink():
            disk.remove(source)
        elif source.exists() or source.is_symlink():
            disk.make_folder(place)
            disk.rename(source, place / f"{name.replace('/', '--')}.{secrets.token_hex(4)}")
    for folder in sorted((root / ROBOTS).rglob("*"), reverse=True):
        if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
            disk.remove_folder(folder)

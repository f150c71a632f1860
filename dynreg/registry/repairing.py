"""A registry brought in line with its files: what is sound is kept, what is not is put away, and rows follow."""

import os
import secrets
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.catalog import BESIDE, FILE, Catalog
from dynreg.registry.comparing import Fault, VerifyReport
from dynreg.registry.examining import Examined, Stored, examine, keyed, stored_in
from dynreg.registry.files import (
    CACHE,
    INDEX,
    LEDGER,
    LOST_AND_FOUND,
    ROBOTS,
    sweep,
    temporary_folder,
    temporary_name,
    write_file,
)
from dynreg.registry.ledger import last_number, pages_after
from dynreg.registry.opening import lost_catalog, make_folders
from dynreg.registry.rebuild import Rows, manifest_of, new_rows, paths_in
from dynreg.registry.sweeping import remove_files
from dynreg.registry.tables import Values, values_of
from dynreg.registry.writing import Writing

# Bytes: a repair asks for so many beside three times the catalogue and the ledger, of which it makes copies.
_SPARE = 1 << 20


def repaired(path: Path) -> VerifyReport:
    """Repair the registry in the folder `path`; what was found."""
    if (path / FILE).exists() and not lost_catalog(path):
        with suppress(CorruptError):  # one of format 1 is brought up to date first, where that can be done
            Catalog(path).close()
    with stored_in(path, "BEGIN IMMEDIATE") as stored:
        rows, changed, examined, report = mended(path, stored)
    if stored.connection is None:
        if changed:
            _rebuild(path, _values(rows))
        _clear(path, rows, examined)
    sweep(path)
    return report


def mended(path: Path, stored: Stored) -> tuple[Rows, bool, Examined, VerifyReport]:
    """The rows of all that is sound, whether they are others than before, and what was found.

    Where the catalogue can be written they are in it then, and what is no part of the registry is out of the way: while
    nobody else can put anything.
    """
    examined = examine(path, stored)
    back = _put_back(path, examined)
    if back:
        examined = examine(path, stored)
    rows = new_rows(path, examined.held, examined.found, adopt=examined.rows_lost)
    changed = bool(examined.faulty) or examined.behind or keyed(rows) != keyed(examined.held)
    if stored.connection is not None:
        if changed:
            stored.catalog.begin_anew(Writing(stored.connection), _values(rows), last_number(path))
        _clear(path, rows, examined)
    faults = (*back, *_nameless(rows, examined), *examined.report.faults)
    return rows, changed, examined, replace(examined.report, faults=faults)


def _clear(path: Path, rows: Rows, examined: Examined) -> None:
    remove_files(path, examined.removed)
    put_away(path, _strays(rows, examined))


def _misnamed(examined: Examined) -> list[tuple[str, str]]:
    """(name that it has, name that it was registered under) of files whose registered name is gone or another's."""
    hashes = examined.found.hashes
    right = {row["path"]: row["sha256"] for row in examined.held["files"]}
    free = {sha256: name for name, sha256 in hashes.items() if right.get(name) != sha256}
    return [
        (free[sha256], name)
        for name, sha256 in right.items()
        if hashes.get(name) != sha256 and sha256 in free
    ]


def _put_back(path: Path, examined: Examined) -> list[Fault]:
    """Give registered files their names again, whose bytes lie under others; what was done."""
    moves = _misnamed(examined)
    beside = [(old, temporary_name(path / new), path / new) for old, new in moves]
    for old, hidden, _ in beside:  # two files may have each other's names
        disk.rename(path / old, hidden)
    taken = {old for old, _ in moves}
    put_away(path, [new for _, new in moves if new not in taken])  # damaged files that have the names
    for _, hidden, new in beside:
        disk.rename(hidden, new)
        disk.sync_folder(new.parent)
    return _moved(moves)


def _moved(moves: list[tuple[str, str]]) -> list[Fault]:
    return [Fault("file", new, f"its bytes lie in {old}", lost=False) for old, new in moves]


def foreseen(path: Path, examined: Examined, report: VerifyReport) -> VerifyReport:
    """The report with what a repair would add to it: files that get their names again, recordings that get none."""
    moves = _misnamed(examined)
    there = {name for move in moves for name in move}
    rows = new_rows(path, examined.held, examined.found, adopt=examined.rows_lost)
    kept = [fault for fault in report.faults if fault.what not in there]
    return replace(report, faults=(*_moved(moves), *_nameless(rows, examined), *kept))


def _nameless(rows: Rows, examined: Examined) -> list[Fault]:
    """Recordings that got rows from their files alone: nothing tells their names, or which was the last."""
    known = {row["id"] for row in examined.held["recordings"]}
    problem = "nothing tells its names and its place in the order any more"
    return [
        Fault("recording name", row["id"][:12], problem, lost=True)
        for row in rows["recordings"]
        if row["id"] not in known
    ]


def _strays(rows: Rows, examined: Examined) -> list[str]:
    """Files that are no part of what is held: damaged ones, and those that were added to a robot's folder."""
    known = paths_in(rows) | set(examined.bad_pages)
    robots = {f"{ROBOTS}/{row['hash']}/{name}" for row in rows["robots"] for name in manifest_of(row)}
    added = [
        fault.what for fault in examined.report.faults if fault.kind == "stray" and fault.what not in robots
    ]
    damaged = [name for name in examined.found.bad if name not in known | robots]
    return sorted({*added, *damaged, *examined.bad_pages})


def _values(rows: Rows) -> dict[str, list[Values]]:
    return {t.name: [values_of(t, row) for row in rows[t.name]] for t in tables.HELD}


def _rebuild(path: Path, rows: dict[str, list[Values]]) -> None:
    """A new catalogue and the page that it follows, made beside the old ones; they take their places at the end."""
    with temporary_folder(path / FILE) as place:
        make_folders(place)
        catalog = Catalog(place)
        try:
            with catalog.transaction("BEGIN IMMEDIATE") as connection:
                catalog.begin_anew(Writing(connection), rows, last_number(path))
        finally:
            catalog.close()
        if (place / BESIDE[0]).exists():  # SQLite keeps to itself that it could not fold its log in
            raise disk.refused("write", path / FILE, OSError(f"{BESIDE[0]} could not be folded in"))
        for page in pages_after(place, 0):
            disk.rename(page, path / LEDGER / page.name)
        disk.sync_folder(path / LEDGER)
        if (path / FILE).exists():  # kept, and never without a name
            kept = path / LOST_AND_FOUND / f"{FILE}.{secrets.token_hex(4)}"
            disk.make_folder(kept.parent)
            write_file(kept, (path / FILE).read_bytes())
        # The old log first: SQLite would play it into the new catalogue.
        put_away(path, [name for name in BESIDE if (path / name).exists()])
        disk.rename(place / FILE, path / FILE)
        disk.sync_folder(path)


def check_room(path: Path) -> None:
    """Ask for the room that a repair may need, before it touches anything; RegistryError where there is none."""
    sizes = [p.stat().st_size for p in (path / FILE, path / BESIDE[0], *pages_after(path, 0)) if p.exists()]
    probe = temporary_name(path / "room")
    try:
        descriptor = disk.create(probe)
        try:
            for _ in range(1 + 3 * sum(sizes) // _SPARE):
                disk.write(descriptor, bytes(_SPARE))
            disk.sync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        needed = (_SPARE + 3 * sum(sizes)) / 1e6
        raise RegistryError(
            f"a repair of {str(path)!r} may need {needed:.1f} MB: {error.strerror}",
            expected="so much room on its disk",
            do="free some space, then run the same command again; nothing was changed",
        ) from error
    finally:
        disk.remove(probe)


def put_away(root: Path, names: list[str]) -> None:
    """Move files out of the way, to `lost+found/`; files of indexes, which are computed again, are removed."""
    place = root / LOST_AND_FOUND
    touched = set()
    for name in names:
        source = root / name
        if name.split("/")[0] in (INDEX, CACHE) and not source.is_symlink():
            disk.remove(source)
        elif source.exists() or source.is_symlink():
            disk.make_folder(place)
            disk.rename(source, place / f"{name.replace('/', '--')}.{secrets.token_hex(4)}")
            touched.add(place)
        touched.add(source.parent)
    for folder in sorted((root / ROBOTS).rglob("*"), reverse=True):
        if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
            disk.remove_folder(folder)
            touched.add(folder.parent)
    for folder in sorted(touched):
        if folder.is_dir():
            disk.sync_folder(folder)

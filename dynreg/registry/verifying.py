"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

import os
import secrets
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import dynreg.registry.disk as disk
import dynreg.registry.migrations as migrations
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.bucket import Remote
from dynreg.registry.catalog import BESIDE, FILE, Catalog
from dynreg.registry.comparing import Fault, VerifyReport, again
from dynreg.registry.directory import Directory
from dynreg.registry.examining import Examined, Stored, examine, keyed, read_served, stored_in
from dynreg.registry.files import (
    CACHE,
    INDEX,
    LEDGER,
    LOCKS,
    LOST_AND_FOUND,
    ROBOTS,
    sweep,
    temporary_folder,
    temporary_name,
    try_lock,
    write_file,
)
from dynreg.registry.ledger import last_number, pages_after
from dynreg.registry.mirroring import bring_all, send_back
from dynreg.registry.opening import (
    MARKER,
    check_links,
    check_marker,
    lost_catalog,
    lost_marker,
    make_folders,
    may_write,
    write_marker,
)
from dynreg.registry.rebuild import Rows, manifest_of, new_rows, paths_in
from dynreg.registry.scan import damaged_here
from dynreg.registry.seal import lost_tables
from dynreg.registry.sharing import Shared, open_shared, shared_at
from dynreg.registry.sweeping import remove_files
from dynreg.registry.tables import Values, values_of
from dynreg.registry.writing import Writing

# Bytes: a repair asks for so many beside three times the catalogue and the ledger, of which it makes copies.
_SPARE = 1 << 20
_EMPTY = (Fault("catalog", "on the server", "it lacks what the bucket holds", lost=False),)


def verify(path: Path, repair: bool = False, dry_run: bool = False) -> VerifyReport:
    """Compare catalogue, ledger and files of the registry at `path`, hash by hash and row by row.

    With `repair` catalogue and ledger are brought in line with the files: lost entries are taken out, so that a
    populate computes them again; damaged and added files are moved to `lost+found/`; files under other names get their
    own again; where pages of the ledger are lost, sound files that no row knows are adopted; a damaged catalogue is
    written anew beside the old one and takes its place at the end. Populations and robots that lost their own files
    stay, to be healed by putting them again. Other writers wait meanwhile. With `dry_run` nothing is changed, and the
    faults say what a repair would do.

    Raises RegistryError when there is no registry at `path`, a part of it is a link, or its disk is full, fails or may
    not be written for a repair: nothing is changed then.
    """
    path = Path(path)
    if (told := shared_at(path)) is not None:
        return _of_shared(path, told, repair and not dry_run, dry_run)
    unmarked = lost_marker(path)
    if not unmarked:
        check_marker(path)
    check_links(path)
    marker = (Fault("marker", MARKER, "it is missing or damaged", lost=False),) if unmarked else ()
    if dry_run or not repair:
        with stored_in(path, "BEGIN") as stored:
            examined = examine(path, stored)
        report = replace(examined.report, faults=(*marker, *examined.report.faults))
        return _with_words(_foreseen(path, examined, report), "would be ") if dry_run else report
    if not may_write(path):
        raise RegistryError(
            f"{str(path)!r} is read-only",
            expected="a writable registry",
            do="copy it, or mend its permissions",
        )
    _check_room(path)
    make_folders(path)
    with try_lock(path / LOCKS / "repair.lock") as mine:
        if not mine:
            raise RegistryError(
                f"another process repairs {str(path)!r}",
                expected="one repair at a time",
                do="wait for it to end",
            )
        report = _repaired(path)
        if unmarked:
            write_marker(path)
        return _with_words(replace(report, faults=(*marker, *report.faults)))


def _of_shared(path: Path, told: Shared, repair: bool, dry_run: bool) -> VerifyReport:
    """`verify` of a shared registry: its bucket is copied to a folder here; what a repair changes there goes back."""
    directory = open_shared(path, told, migrate=False)
    with closing(directory), temporary_folder(path / "copy") as place:
        with directory.catalog.transaction("BEGIN") as connection:
            lacking = lost_tables(connection)
        with directory.catalog.transaction("BEGIN IMMEDIATE" if repair or lacking else "BEGIN") as connection:
            directory.take_time(connection)  # the bucket is copied within it
            if lacking:  # they are made for the examination, and stay where it ends with a repair
                tables.metadata.create_all(connection)
                if pending := migrations.pending(connection):
                    connection.execute(tables.migrations.insert(), [{"name": name} for name in pending])
            stored = read_served(place, directory.catalog, connection)
            brought = bring_all(directory.bucket, place, stored.pages)
            lost = _EMPTY if lacking or (not stored.pages and pages_after(place, 0)) else ()
            if repair:
                report = _mended(place, stored)[-1]
                send_back(directory.bucket, place, brought)
            else:
                examined = examine(place, stored)
                report = _foreseen(place, examined, examined.report) if dry_run else examined.report
                connection.rollback()
        where = told.blobs.partition("?")[0]  # what was copied lies there
        faults = [replace(f, problem=f.problem.replace(str(place), where)) for f in report.faults]
        if not dry_run:
            _forget(directory, faults)
        damaged = damaged_here(path)
        faults += [Fault(again(name), name, why, lost=False) for name, why in damaged.items()]
        report = replace(report, faults=(*lost, *faults))
        if repair:
            _put_away(path, list(damaged))
            sweep(path)
        return _with_words(report, "would be " * dry_run) if repair or dry_run else report


def _forget(directory: Directory, faults: Sequence[Fault]) -> None:
    """Remove what lies here, whole or in part, of objects that are damaged in the bucket: a put may heal them there."""
    for fault in faults:
        with suppress(OSError, ValueError, CorruptError):  # it may name no file of a registry
            directory.locate(fault.what).unlink(missing_ok=True)
            Remote(directory.bucket, fault.what, 0).forget()


def _repaired(path: Path) -> VerifyReport:
    if (path / FILE).exists() and not lost_catalog(path):
        with suppress(CorruptError):  # one of format 1 is brought up to date first, where that can be done
            Catalog(path).close()
    with stored_in(path, "BEGIN IMMEDIATE") as stored:
        rows, changed, examined, report = _mended(path, stored)
    if stored.connection is None:
        if changed:
            _rebuild(path, _values(rows))
        _clear(path, rows, examined)
    sweep(path)
    return report


def _mended(path: Path, stored: Stored) -> tuple[Rows, bool, Examined, VerifyReport]:
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
    _put_away(path, _strays(rows, examined))


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
    _put_away(path, [new for _, new in moves if new not in taken])  # damaged files that have the names
    for _, hidden, new in beside:
        disk.rename(hidden, new)
        disk.sync_folder(new.parent)
    return _moved(moves)


def _moved(moves: list[tuple[str, str]]) -> list[Fault]:
    return [Fault("file", new, f"its bytes lie in {old}", lost=False) for old, new in moves]


def _foreseen(path: Path, examined: Examined, report: VerifyReport) -> VerifyReport:
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
        _put_away(path, [name for name in BESIDE if (path / name).exists()])
        disk.rename(place / FILE, path / FILE)
        disk.sync_folder(path)


def _check_room(path: Path) -> None:
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


_MENDED = {
    "marker": "written anew",
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
    "file": "given its name again",
    "recording name": "entered again without a name",
    "row": "written anew from what was put, or taken out",
    "stray": f"moved to {LOST_AND_FOUND}/",
}


def _with_words(report: VerifyReport, before: str = "") -> VerifyReport:
    """The report with what a repair does to each fault, or `before` it what it would."""
    said = {kind: before + text for kind, text in _MENDED.items()}
    faults = tuple(replace(f, mended=said.get(f.kind)) for f in report.faults)
    return replace(report, faults=faults)


def _put_away(root: Path, names: list[str]) -> None:
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

"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import dynreg.registry.migrations as migrations
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.bucket import Remote
from dynreg.registry.comparing import Fault, VerifyReport, again
from dynreg.registry.directory import Directory
from dynreg.registry.examining import examine, read_served, stored_in
from dynreg.registry.files import LOCKS, LOST_AND_FOUND, sweep, temporary_folder, try_lock
from dynreg.registry.ledger import last_number, pages_after
from dynreg.registry.mirroring import bring_all, send_back
from dynreg.registry.opening import (
    MARKER,
    check_links,
    check_marker,
    lost_marker,
    make_folders,
    may_write,
    tells_of_puts,
    write_marker,
)
from dynreg.registry.repairing import check_room, foreseen, mended, put_away, repaired
from dynreg.registry.scan import damaged_here
from dynreg.registry.seal import drop_views, lost_tables
from dynreg.registry.served import ServedCatalog
from dynreg.registry.server import persistent
from dynreg.registry.sharing import Shared, open_shared, share, shared_at

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
    not be written for a repair, LimitError or MemoryError where a file asks for more than a limit or the memory allows,
    which tells nothing of its soundness: nothing is changed then.
    """
    path = Path(path)
    if (told := shared_at(path)) is not None:
        check_links(path)
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
        return _with_words(foreseen(path, examined, report), "would be ") if dry_run else report
    if not may_write(path):
        raise RegistryError(
            f"{str(path)!r} is read-only",
            expected="a writable registry",
            do="copy it, or mend its permissions",
        )
    check_room(path)
    make_folders(path)
    with try_lock(path / LOCKS / "repair.lock") as mine:
        if not mine:
            raise RegistryError(
                f"another process repairs {str(path)!r}",
                expected="one repair at a time",
                do="wait for it to end",
            )
        report = repaired(path)
        if unmarked:
            write_marker(path)
        return _with_words(replace(report, faults=(*marker, *report.faults)))


def rebuild(path: Path, catalog: str, blobs: str) -> VerifyReport:
    """Make `path` the face of a registry whose catalogue is lost, which is written anew from the bucket; what was lost.

    Its database has to be an empty one. The bucket's ledger tells all that was put, names and order too. Raises
    RegistryError as `sharing.share`.
    """
    share(path, Shared(catalog, blobs), lost=True)
    return verify(path, repair=True)


def _of_shared(path: Path, told: Shared, repair: bool, dry_run: bool) -> VerifyReport:
    """`verify` of a shared registry; what a server broke off is made again, but for a repair, which changes things."""
    with closing(open_shared(path, told, migrate=False)) as directory:
        with directory.catalog.transaction("BEGIN") as connection:
            lacking = lost_tables(connection)
        compared = _compared if repair else persistent(_compared)
        report = compared(directory, told, lacking, repair, dry_run)
        if repair:
            sweep(path)
        return _with_words(report, "would be " * dry_run) if repair or dry_run else report


def _compared(
    directory: Directory, told: Shared, lacking: Sequence[str], repair: bool, dry_run: bool
) -> VerifyReport:
    """The bucket is copied to a folder here, and compared there; what a repair changes there goes back.

    lacking : tables that the catalogue lacks.
    """
    path = directory.path
    with temporary_folder(path / "copy") as place:
        with directory.catalog.transaction("BEGIN IMMEDIATE" if repair or lacking else "BEGIN") as connection:
            directory.take_time(connection)  # the bucket is copied within it
            if lacking:  # they are made for the examination, and stay where it ends with a repair
                drop_views(connection, lacking)
                tables.metadata.create_all(connection)
                if pending := migrations.pending(connection):
                    connection.execute(tables.migrations.insert(), [{"name": name} for name in pending])
            stored = read_served(place, directory.catalog, connection)
            brought = bring_all(directory.bucket, place, stored.pages)
            if not stored.pages and not pages_after(place, 0) and tells_of_puts(brought):
                stored = replace(stored, faults=("it is lost, and the ledger with it",))  # all rows are new
            lost = _EMPTY if lacking or (not stored.pages and pages_after(place, 0)) else ()
            lost = lost or _older(directory.catalog, place)
            if repair:
                report = mended(place, stored)[-1]
                send_back(directory.bucket, place, brought)
            else:
                examined = examine(place, stored)
                report = foreseen(place, examined, examined.report) if dry_run else examined.report
                connection.rollback()
        where = told.blobs.partition("?")[0]  # what was copied lies there
        faults = [replace(f, problem=f.problem.replace(str(place), where)) for f in report.faults]
        if not dry_run:
            _forget(directory, faults)
        damaged = damaged_here(path)
        faults += [Fault(again(name), name, why, lost=False) for name, why in damaged.items()]
        report = replace(report, faults=(*lost, *faults))
        if repair:
            put_away(path, list(damaged))
        return report


def _older(catalog: ServedCatalog, place: Path) -> tuple[Fault, ...]:
    """The fault of a catalogue that was put back from a backup: the bucket has later pages, more than the one of a put.

    It is asked anew: others may have put since it was read.
    """
    later = last_number(place) - catalog.last_page()
    problem = f"it lacks what the bucket's last {later} pages tell: it is older than they are"
    return (Fault("catalog", "on the server", problem, lost=False),) if later > 1 else ()


def _forget(directory: Directory, faults: Sequence[Fault]) -> None:
    """Remove what lies here, whole or in part, of objects that are damaged in the bucket: a put may heal them there."""
    for fault in faults:
        with suppress(OSError, ValueError, CorruptError):  # it may name no file of a registry
            directory.locate(fault.what).unlink(missing_ok=True)
            Remote(directory.bucket, fault.what, 0).forget()


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

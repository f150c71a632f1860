"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

import secrets
from dataclasses import replace
from pathlib import Path

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import RegistryError
from dynreg.registry.catalog import BESIDE, FILE, Catalog
from dynreg.registry.comparing import VerifyReport
from dynreg.registry.examining import examine, keyed, stored_in
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
from dynreg.registry.ledger import pages_after
from dynreg.registry.opening import check_links, check_marker, make_folders, may_write
from dynreg.registry.rebuild import Rows, new_rows, unknown_files
from dynreg.registry.tables import Values, values_of
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
        with stored_in(path, "BEGIN") as stored:
            report = examine(path, stored).report
        return _with_words(report, "would be ") if dry_run else report
    if not may_write(path):
        raise RegistryError(f"{str(path)!r} is read-only", expected="a writable registry", do="copy it first")
    _check_room(path)
    make_folders(path)
    with stored_in(path, "BEGIN IMMEDIATE") as stored:
        examined = examine(path, stored)
        rows = new_rows(path, examined.held, examined.found)
        changed = bool(examined.faulty) or keyed(rows) != keyed(examined.held)
        if changed and stored.connection is not None:
            stored.catalog.begin_anew(Writing(stored.connection), _values(rows))
    if changed and stored.connection is None:
        _rebuild(path, _values(rows))
    _put_away(path, [*unknown_files(rows, examined.found), *examined.ledger.bad])
    sweep(path)
    return _with_words(examined.report)


def _values(rows: Rows) -> dict[str, list[Values]]:
    return {t.name: [values_of(t, row) for row in rows[t.name]] for t in tables.HELD}


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
        if (place / BESIDE[0]).exists():  # SQLite keeps to itself that it could not fold its log in
            raise disk.refused("write", path / FILE, OSError(f"{BESIDE[0]} could not be folded in"))
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
        disk.remove(probe)


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

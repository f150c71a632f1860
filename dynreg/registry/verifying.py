"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

import os
import secrets
from dataclasses import replace
from pathlib import Path

from sqlalchemy import Connection, select, text

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, DynregError, RegistryError
from dynreg.registry.catalog import FILE, Catalog
from dynreg.registry.comparing import Fault, VerifyReport, compare
from dynreg.registry.directory import check_marker, make_folders
from dynreg.registry.files import LOST_AND_FOUND, ROBOTS, sweep
from dynreg.registry.rebuild import Rows, paths_in, replace_rows
from dynreg.registry.scan import scan


def verify(path: Path, repair: bool = False) -> VerifyReport:
    """Compare catalogue and files of the registry at `path`, hash by hash and row by row.

    With `repair` the catalogue is brought in line with the files: lost entries are taken out, so that a
    populate computes them again; sound files without a row are adopted; all other strange files are moved
    to `lost+found/`; stale indexes are dropped; a damaged catalogue is written anew. Populations and
    robots that lost their own files stay, to be healed by putting them again. Other writers wait meanwhile.

    Raises RegistryError when there is no registry at `path`, or when it cannot be written for a repair.
    """
    path = Path(path)
    check_marker(path)
    held, faults = _read_catalog(path)
    if not repair:
        found = scan(path, paths_in(held))
        still = paths_in(_read_catalog(path)[0])  # an index may be replaced while the files are read
        for name in ("files", "indexes"):
            held[name] = [row for row in held[name] if row["path"] in still]
        return compare(held, found, faults)
    if not os.access(path, os.W_OK):
        raise RegistryError(f"{str(path)!r} is read-only", expected="a writable registry", do="copy it first")
    make_folders(path)
    damaged = bool(faults)
    if damaged:
        _put_away(path, [name for name in (FILE, f"{FILE}-wal", f"{FILE}-shm") if (path / name).exists()])
    catalog = Catalog(path)
    try:
        with catalog.write() as connection:
            held = held if damaged else _read_rows(connection)
            found = scan(path, paths_in(held))
            report = compare(held, found, faults)
            put_away = replace_rows(connection, path, held, found)
            _put_away(path, put_away)
    finally:
        catalog.close()
    sweep(path)
    return replace(
        report, faults=tuple(replace(fault, mended=_MENDED.get(fault.kind)) for fault in report.faults)
    )


_MENDED = {
    "catalog": "written anew from the stored files",
    "shard": "taken out of the catalogue; a populate computes it again",
    "entries": "rows written anew from the shard",
    "recording": "taken out of the catalogue; ingest its log again",
    "simulator": "taken out of the catalogue",
    "result": "taken out of the catalogue; the command that made it computes it again",
    "index": "dropped; it is computed again when it is needed",
    "row": "written anew from the stored files, or taken out",
    "stray": f"moved to {LOST_AND_FOUND}/",
}


def _read_catalog(path: Path) -> tuple[Rows, list[Fault]]:
    """The catalogue's rows, as far as they can be read, and its own faults."""
    empty: Rows = {name: [] for name in tables.metadata.tables}
    if not (path / FILE).exists():
        return empty, [Fault("catalog", FILE, "it is missing", lost=True)]
    try:
        catalog = Catalog(path)
    except CorruptError as error:
        return empty, [Fault("catalog", FILE, error.problem, lost=True)]
    try:
        with catalog.read() as connection:
            sound = connection.execute(text("PRAGMA integrity_check")).scalars().all()
            rows = _read_rows(connection)
        faults = [] if sound == ["ok"] else [Fault("catalog", FILE, "; ".join(sound[:3]), lost=True)]
        return rows, faults
    except DynregError as error:
        return empty, [Fault("catalog", FILE, error.problem, lost=True)]
    finally:
        catalog.close()


def _read_rows(connection: Connection) -> Rows:
    return {
        name: [dict(row) for row in connection.execute(select(table)).mappings()]
        for name, table in tables.metadata.tables.items()
    }


def _put_away(root: Path, names: list[str]) -> None:
    place = root / LOST_AND_FOUND
    place.mkdir(exist_ok=True)
    for name in names:
        source = root / name
        if name.startswith("index/"):  # a cache
            source.unlink(missing_ok=True)
        elif source.exists() or source.is_symlink():
            os.replace(source, place / f"{name.replace('/', '--')}.{secrets.token_hex(4)}")
    for folder in sorted((root / ROBOTS).rglob("*"), reverse=True):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()

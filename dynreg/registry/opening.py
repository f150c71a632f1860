"""How a registry is opened or made: its marker, its folders, and what it is if it may only be read."""

import json
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from sqlalchemy import func, select

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.catalog import BESIDE, FILE, Catalog
from dynreg.registry.directory import Directory
from dynreg.registry.files import (
    CACHE,
    CONTENTS,
    FOLDERS,
    LEDGER,
    LOCKS,
    LOST_AND_FOUND,
    SEARCHES,
    is_temporary,
    temporary_name,
    write_file,
)
from dynreg.registry.ledger import pages_after

MARKER = "dynreg.json"
VERSION = 2  # 2 came with the ledger


def open_directory(path: Path, create: bool) -> Directory:
    """Open (or create) the registry at `path`; one that may only be read gets a temporary folder for what is put.

    Raises
    ------
    RegistryError : nothing there, not a registry, written by a newer version, locked, no room, a link in it.
    CorruptError : the catalogue is lost or damaged.
    """
    made = not path.exists()
    if not (path / MARKER).is_file():
        _create(path, create)
    check_marker(path)
    check_links(path)
    if lost_catalog(path):
        raise CorruptError(
            f"the catalogue {str(path / FILE)!r} is lost or empty",
            expected="a registry with its catalogue",
            do="restore it from a copy, or run `dynreg verify --repair` to rebuild it from the stored files",
        )
    if not may_write(path):
        return beside(path)
    make_folders(path)
    catalog = Catalog(path)
    if _version(path) != VERSION:
        _write_marker(path)
    return Directory(path, catalog, made=made)


def take_away(directory: Directory) -> None:
    """Close a registry, and remove it where its own opening made it and at most robots were stored in it since."""
    unused = directory.made and not _holds_any(directory.catalog)
    directory.close()
    if unused:
        gone = temporary_name(directory.path)  # whoever looks in the meantime finds all of it, or nothing
        with suppress(OSError, RegistryError):  # an empty registry that stays does no harm
            disk.rename(directory.path, gone)
            shutil.rmtree(gone)


def may_write(path: Path) -> bool:
    """Whether a registry may be written: by its permissions, and by its mount."""
    mount = os.statvfs(path).f_flag if hasattr(os, "statvfs") else 0
    catalog = path / FILE
    return (
        os.access(path, os.W_OK)
        and not mount & getattr(os, "ST_RDONLY", 1)
        and (not catalog.exists() or os.access(catalog, os.W_OK))
    )


def lost_catalog(path: Path) -> bool:
    """Whether things are stored at `path`, and the catalogue that tells of them is missing or empty."""
    catalog = path / FILE
    if catalog.exists() and catalog.stat().st_size:
        return False
    folders = [path / name for name in (*CONTENTS, LEDGER)]
    return any(not is_temporary(p.name) for f in folders if f.is_dir() for p in f.iterdir())


def check_marker(path: Path) -> None:
    """RegistryError when `dynreg.json` is not the marker of a registry that this version can read."""
    version = _version(path)
    if version is None or not 1 <= version <= VERSION:
        what = "not the marker of a registry" if version is None else f"of format {version}"
        raise RegistryError(
            f"{str(path / MARKER)!r} is {what}",
            expected=f"a registry of format {VERSION} or older",
            do="upgrade dynreg" if version else "give the directory of a registry",
        )


def check_links(path: Path) -> None:
    """RegistryError when a part of the registry is a link: it would be written, or cleared, somewhere else."""
    names = (MARKER, FILE, *BESIDE, *FOLDERS, LOCKS, CACHE, SEARCHES, LOST_AND_FOUND)
    links = [name for name in names if (path / name).is_symlink()]
    if links:
        raise RegistryError(
            f"{links[0]!r} in the registry {str(path)!r} is a link",
            expected="a registry whose parts lie in its own directory",
            do="put the folder itself in the link's place, or move the whole registry and link to that",
        )


def make_folders(path: Path) -> None:
    """The folders of a registry, made where they are missing (an archive may drop empty ones)."""
    for name in (*FOLDERS, LOCKS):
        disk.make_folder(path / name)


def beside(path: Path) -> Directory:
    """A registry that may only be read: its catalogue is copied to a temporary folder, where it can be brought up."""
    try:
        home = Path(tempfile.mkdtemp(prefix="dynreg-"))
    except OSError as error:
        raise RegistryError(
            f"{str(path)!r} is read-only, and there is no temporary folder to work in: {error.strerror}",
            expected="a place for temporary files",
            do="set TMPDIR to a folder that may be written",
        ) from error
    try:
        make_folders(home)
        for name in (FILE, BESIDE[0]):
            if (path / name).exists():
                shutil.copyfile(path / name, home / name)
        catalog = Catalog(home)
        for page in pages_after(path, catalog.last_page()):
            shutil.copyfile(page, home / LEDGER / page.name)
        return Directory(path, catalog, home)
    except BaseException:
        shutil.rmtree(home, ignore_errors=True)
        raise


def _holds_any(catalog: Catalog) -> bool:
    """Whether there is anything that was asked for; robots come along with other things."""
    asked_for = (tables.populations, tables.recordings, tables.simulators, tables.results)
    with catalog.read() as connection:
        counts = [connection.execute(select(func.count()).select_from(t)).scalar_one() for t in asked_for]
    return any(counts)


def _version(path: Path) -> int | None:
    try:
        marker = json.loads((path / MARKER).read_bytes())
        return int(marker["version"]) if marker["format"] == "dynreg-registry" else None
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _write_marker(path: Path) -> None:
    marker = {"format": "dynreg-registry", "version": VERSION}
    write_file(path / MARKER, json.dumps(marker).encode() + b"\n")


def _create(path: Path, create: bool) -> None:
    if path.exists() and not path.is_dir():
        problem = f"{str(path)!r} is a file"
    elif path.is_dir() and any(not is_temporary(p.name) for p in path.iterdir()):
        if (path / MARKER).is_file():  # another process has created it just now
            return
        problem = f"{str(path)!r} is a directory that is not a registry"
    elif not create:
        problem = f"there is no registry at {str(path)!r}"
    else:
        disk.make_folder(path.absolute())
        _write_marker(path)
        return
    raise RegistryError(
        problem,
        expected="a registry directory" + (" or an empty place for a new one" if create else ""),
        do="name another one with --registry, or fill a new one with `dynreg ingest` or `dynreg populate`",
    )

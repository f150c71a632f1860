"""Opening or making a registry: its marker, its folders, and a registry that may only be read."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from sqlalchemy import Connection, func, select

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, NoPlaceError, RegistryError
from dynreg.registry.cache import goes_on
from dynreg.registry.catalog import BESIDE, FILE, Catalog, identity_of
from dynreg.registry.directory import Directory
from dynreg.registry.files import (
    CACHE,
    CONTENTS,
    FOLDERS,
    LEDGER,
    LOCKS,
    LOST_AND_FOUND,
    SEARCHES,
    is_content,
    temporary_name,
    unreadable,
    write_file,
)
from dynreg.registry.ledger import pages_after
from dynreg.registry.sharing import FORMAT, MARKER, open_shared, read_marker, shared_at
from dynreg.registry.sharing import VERSION as SHARED

VERSION = 2  # 2 came with the ledger


def open_directory(path: Path, create: bool, aside: bool = False) -> Directory:
    """Open (or create) the registry at `path`; one that may only be read gets a temporary folder for what is put.

    aside : open it as if it might only be read, so that nothing in its folder changes.

    Raises
    ------
    RegistryError : nothing there, not a registry, written by a newer version, locked, no room, a link in it.
    CorruptError : the catalogue is lost or damaged.
    """
    if (told := shared_at(path)) is not None:
        check_links(path)
        directory = open_shared(path, told)
        try:
            _check_served(directory)
        except BaseException:
            directory.close()
            raise
        return directory
    made = not path.exists()
    if lost_marker(path):
        raise CorruptError(
            f"the marker {str(path / MARKER)!r} is missing or damaged",
            expected="the marker of a registry, as a catalogue and a ledger lie beside it",
            do="run `dynreg verify --repair`, which writes it anew",
        )
    if not (path / MARKER).is_file():
        _create(path, create, aside)
    check_marker(path)
    check_links(path)
    if lost_catalog(path):
        raise CorruptError(
            f"the catalogue {str(path / FILE)!r} is lost or empty",
            expected="a registry with its catalogue",
            do="restore it from a copy, or run `dynreg verify --repair` to rebuild it from the stored files",
        )
    if aside or not may_write(path):
        return beside(path)
    make_folders(path)
    catalog = Catalog(path)
    if _version(path) != VERSION:
        write_marker(path)
    return Directory(path, catalog, made=made)


def take_away(directory: Directory) -> None:
    """Close a registry, and remove it where its own opening made it and at most robots were stored in it since.

    What an interrupted command goes on from keeps it: a search's journal, or the cache. So does another
    process that has it open.
    """
    gone = temporary_name(directory.path)  # whoever looks in the meantime finds all of it, or nothing
    with suppress(OSError, RegistryError):  # an empty registry that stays does no harm
        if directory.made and directory.alone():
            with directory.catalog.write() as writing:  # nobody puts anything meanwhile
                if not _holds_any(writing.connection) and not _can_go_on(directory.path):
                    disk.rename(directory.path, gone)
    directory.close()
    shutil.rmtree(gone, ignore_errors=True)


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
    return any(is_content(p.name) for f in folders if f.is_dir() for p in f.iterdir())


def lost_marker(path: Path) -> bool:
    """Whether a registry lies at `path` whose marker is missing or damaged."""
    return _version(path) is None and (path / FILE).is_file() and (path / LEDGER).is_dir()


def _check_served(directory: Directory) -> None:
    """CorruptError where the catalogue is empty and the bucket holds what was put."""
    if directory.catalog.last_page():
        return
    # a single page may be that of a first put that was cut short
    if len(directory.bucket.names(LEDGER)) > 1 or tells_of_puts(directory.bucket.names("populations")):
        raise CorruptError(
            f"the catalogue of {str(directory.path)!r} is empty, and its bucket is not",
            expected="the catalogue that follows the ledger in the bucket",
            do="restore the database from a backup, or run `dynreg verify --repair` to write it from the ledger",
        )


def tells_of_puts(names: Iterable[str]) -> bool:
    """Whether there are files of which none comes before the robot that they are about is entered."""
    return any(name.split("/")[0] in ("populations", "shards", "recordings", "measured") for name in names)


def check_marker(path: Path) -> None:
    """RegistryError when `dynreg.json` is not the marker of a registry that this version can read."""
    version = _version(path)
    if version is None or not 1 <= version <= SHARED:
        what = "not the marker of a registry" if version is None else f"of format {version}"
        raise RegistryError(
            f"{str(path / MARKER)!r} is {what}",
            expected=f"a registry of format {SHARED} or older",
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
    disk.sync_folder(path)  # another process may have made them, and be cut short before it could


def beside(path: Path) -> Directory:
    """A registry that may only be read: its catalogue is copied to a temporary folder, where it can be brought up."""
    try:
        home = Path(tempfile.mkdtemp(prefix="dynreg-"))
    except OSError as error:
        raise RegistryError(
            f"there is no temporary folder for a copy of the catalogue of {str(path)!r}: {error.strerror}",
            expected="a place for temporary files",
            do="set TMPDIR to a folder that may be written",
        ) from error
    try:
        make_folders(home)
        _copy_catalog(path, home)
        catalog = Catalog(home, shown=path)
        for page in pages_after(path, catalog.last_page()):
            shutil.copyfile(page, home / LEDGER / page.name)
        return Directory(path, catalog, home)
    except BaseException as error:
        shutil.rmtree(home, ignore_errors=True)
        if isinstance(error, OSError):
            raise NoPlaceError(
                f"the catalogue of {str(path)!r} cannot be copied to {str(home)!r}: {error.strerror or error}",
                expected="room for it among the temporary files, and the right to read it",
                do="free some space, or set TMPDIR to a folder with room",
            ) from error
        raise


def _copy_catalog(path: Path, home: Path) -> None:
    """Copy the catalogue with its log as they are at one moment, while its owner may be writing."""
    for _ in range(20):
        before = [identity_of(path / name) for name in (FILE, BESIDE[0])]
        for name in (FILE, BESIDE[0]):
            (home / name).unlink(missing_ok=True)
            with suppress(FileNotFoundError):  # a log may have been folded in
                shutil.copyfile(path / name, home / name)
        if before == [identity_of(path / name) for name in (FILE, BESIDE[0])]:
            return
    raise RegistryError(
        f"the catalogue {str(path / FILE)!r} is written all the time",
        expected="a moment without a write, to copy it",
        do="run the same command again when its owner is done",
    )


def _holds_any(connection: Connection) -> bool:
    """Whether there is anything that was asked for; robots come along with other things."""
    asked_for = (tables.populations, tables.recordings, tables.simulators, tables.results)
    return any(connection.execute(select(func.count()).select_from(t)).scalar_one() for t in asked_for)


def _can_go_on(path: Path) -> bool:
    """Whether a search has left a journal with a step in it, behind its head, or a command its finds in the cache."""
    journals = (path / SEARCHES).glob("*.jsonl")
    return any(journal.read_bytes().count(b"\n") > 1 for journal in journals) or goes_on(path)


def _version(path: Path) -> int | None:
    try:
        marker = read_marker(path)
    except OSError as error:
        problem = unreadable(path / MARKER, error)
        if isinstance(problem, CorruptError):
            return None
        raise problem from error
    return None if marker is None else int(marker["version"])


def write_marker(path: Path) -> None:
    """Write the marker of a registry of this version's format."""
    marker = {"format": FORMAT, "version": VERSION}
    write_file(path / MARKER, json.dumps(marker).encode() + b"\n")


def _create(path: Path, create: bool, aside: bool) -> None:
    if path.exists() and not path.is_dir():
        problem = f"{str(path)!r} is a file"
    elif path.is_dir() and any(is_content(p.name) for p in path.iterdir()):
        if (path / MARKER).is_file():  # another process has created it just now
            return
        problem = f"{str(path)!r} is a directory that is not a registry"
    elif not create:
        problem = f"there is no registry at {str(path)!r}"
    else:
        disk.make_folder(path.absolute())
        write_marker(path)
        return
    raise RegistryError(
        problem,
        expected="a registry directory" + (" or an empty place for a new one" if create else ""),
        do="give the folder of a registry, such as an export writes"
        if aside
        else "name another one with --registry, or fill a new one with `dynreg ingest` or `dynreg populate`",
    )

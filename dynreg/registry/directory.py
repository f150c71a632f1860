"""The registry as a directory: its marker, its folders, and files registered with their hashes."""

import json
import os
import shutil
from contextlib import suppress
from pathlib import Path, PurePosixPath

from sqlalchemy import Connection, func, insert, select

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry.catalog import FILE, Catalog
from dynreg.registry.files import (
    FOLDERS,
    LOCKS,
    StoredFile,
    is_temporary,
    sha256_of,
    sync_folder,
    temporary_name,
    unreadable,
    write_file,
)
from dynreg.registry.rows import row_of

MARKER = "dynreg.json"
VERSION = 1


class Directory:
    """An open registry directory and its catalogue; `made` where this opening made it."""

    def __init__(self, path: Path, catalog: Catalog, made: bool = False):
        self.path = path
        self.catalog = catalog
        self.made = made

    def stage(self, file: StoredFile, data: bytes) -> None:
        """Bring `data` to disk, before the transaction that registers it."""
        self.catalog.check_writable()
        if not self.holds(file):
            write_file(self.path / file.path, data)

    def register(self, connection: Connection, file: StoredFile, data: bytes) -> None:
        """Enter a staged file into the catalogue, inside the caller's transaction."""
        if not (self.path / file.path).exists():  # a repair took it for an orphan in the meantime
            write_file(self.path / file.path, data)
        if row_of(connection, tables.files, file.path) is None:
            connection.execute(
                insert(tables.files).values(path=file.path, sha256=file.sha256, size=file.size)
            )

    def holds(self, file: StoredFile) -> bool:
        """True when the file is on disk with exactly these bytes."""
        path = self.locate(file.path)
        return path.is_file() and path.stat().st_size == file.size and sha256_of(path) == file.sha256

    def locate(self, relative: str) -> Path:
        """Where a registered file lies; CorruptError for a path that leads out of the registry."""
        parts = PurePosixPath(relative).parts
        if not parts or parts[0] not in FOLDERS or ".." in parts:
            raise CorruptError(
                f"the catalogue names the file {relative!r}",
                expected="a path inside the registry",
                do="do not use this registry: its catalogue was changed from outside",
            )
        return self.path / relative

    def read_json(self, relative: str) -> dict:
        """A registered JSON document; CorruptError when it is missing or no JSON object."""
        path = self.locate(relative)
        try:
            document = json.loads(path.read_bytes())
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error
        if not isinstance(document, dict):
            raise unreadable(path, "it is not a JSON object")
        return document


def open_directory(path: Path, create: bool) -> Directory:
    """Open (or create) the registry at `path`.

    Raises
    ------
    RegistryError : nothing there, not a registry, written by a newer version, locked, not writable.
    CorruptError : the catalogue is lost or damaged.
    """
    made = not path.exists()
    if not (path / MARKER).is_file():
        _create(path, create)
    check_marker(path)
    stored = any(any((path / name).glob("*")) for name in FOLDERS)
    if not (path / FILE).exists() and stored:
        raise CorruptError(
            f"the catalogue {str(path / FILE)!r} is lost",
            expected="a registry with its catalogue",
            do="restore it from a copy, or run `dynreg verify --repair` to rebuild it from the stored files",
        )
    if os.access(path, os.W_OK):
        make_folders(path)
    return Directory(path, Catalog(path), made)


def take_away(directory: Directory) -> None:
    """Close a registry, and remove it where its own opening made it and at most robots were stored in it since."""
    unused = directory.made and not _holds_any(directory.catalog)
    directory.catalog.close()
    if unused:
        gone = temporary_name(directory.path)  # whoever looks in the meantime finds all of it, or nothing
        with suppress(OSError):  # an empty registry that stays does no harm
            directory.path.rename(gone)
            shutil.rmtree(gone)


def _holds_any(catalog: Catalog) -> bool:
    """Whether there is anything that was asked for; robots come along with other things."""
    asked_for = (tables.populations, tables.recordings, tables.simulators, tables.results)
    with catalog.read() as connection:
        counts = [connection.execute(select(func.count()).select_from(t)).scalar_one() for t in asked_for]
    return any(counts)


def check_marker(path: Path) -> None:
    """RegistryError when `dynreg.json` is not the marker of a registry that this version can read."""
    try:
        marker = json.loads((path / MARKER).read_bytes())
        version = int(marker["version"]) if marker["format"] == "dynreg-registry" else None
    except (OSError, ValueError, KeyError, TypeError):
        version = None
    if version is None or version > VERSION:
        what = "not the marker of a registry" if version is None else f"of format {version}"
        raise RegistryError(
            f"{str(path / MARKER)!r} is {what}",
            expected=f"a registry of format {VERSION} or older",
            do="upgrade dynreg" if version else "give the directory of a registry",
        )


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
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RegistryError(
                f"cannot create {str(path)!r}: {error.strerror}",
                expected="a place that may be written",
                do="name another directory with --registry",
            ) from error
        marker = {"format": "dynreg-registry", "version": VERSION}
        write_file(path / MARKER, json.dumps(marker).encode() + b"\n")
        return
    raise RegistryError(
        problem,
        expected="a registry directory" + (" or an empty place for a new one" if create else ""),
        do="name another one with --registry, or fill a new one with `dynreg ingest` or `dynreg populate`",
    )


def make_folders(path: Path) -> None:
    """The folders of a registry, made where they are missing (an archive may drop empty ones)."""
    for name in (*FOLDERS, LOCKS):
        (path / name).mkdir(exist_ok=True)
    sync_folder(path)

"""The registry as a directory: its marker, its folders, and its files, each compared with its hash before use."""

import json
import shutil
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path, PurePosixPath

from sqlalchemy import select

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError
from dynreg.registry.catalog import Catalog
from dynreg.registry.files import (
    FOLDERS,
    StoredFile,
    content_hash,
    read_regular,
    sha256_of,
    try_lock,
    unreadable,
    write_file,
)
from dynreg.registry.writing import Writing

Identity = tuple[int, int, int, int, int]
# sha256 of the files that this process has read whole, as long as they stay so
_CHECKED: dict[Identity, str] = {}


class Directory:
    """An open registry directory and its catalogue.

    Attributes
    ----------
    path : where the registry lies.
    home : where it is written: `path`; of a registry that may only be read, a temporary folder that goes when it is
        closed.
    made : whether this opening made it.
    """

    def __init__(self, path: Path, catalog: Catalog, home: Path | None = None, made: bool = False):
        self.path = path
        self.home = home or path
        self.catalog = catalog
        self.made = made
        self._held = ExitStack()
        if self.read_only:  # for as long as the lock is held, `gc` leaves the folder alone
            self._held.enter_context(try_lock(self.home, create=False))

    @property
    def read_only(self) -> bool:
        """Whether what is put goes no further than to a temporary folder."""
        return self.home != self.path

    def close(self) -> None:
        """Let go of the catalogue, and of what was put into a registry that may only be read."""
        self.catalog.close()
        self._held.close()
        if self.read_only:
            shutil.rmtree(self.home, ignore_errors=True)

    def stage(self, file: StoredFile, data: bytes) -> None:
        """Bring `data` to disk, before the transaction that registers it."""
        if not self.holds(file):
            write_file(self.home / file.path, data)
        elif not self.read_only:  # whoever wrote it may have been cut short before its name was synced
            disk.sync_folder((self.home / file.path).parent)

    def register(self, writing: Writing, file: StoredFile, data: bytes) -> None:
        """Enter a staged file into the catalogue, inside the caller's transaction."""
        if not self.locate(file.path).exists():  # a repair took it for an orphan in the meantime
            write_file(self.home / file.path, data)
        writing.put(tables.files, {"path": file.path, "sha256": file.sha256, "size": file.size})

    def holds(self, file: StoredFile) -> bool:
        """True when the file is on disk with exactly these bytes."""
        with suppress(OSError):
            return _hash_of(self.locate(file.path)) == file.sha256
        return False

    def locate(self, relative: str) -> Path:
        """Where a registered file lies; CorruptError for a path that leads out of the registry."""
        parts = PurePosixPath(relative).parts
        if not parts or parts[0] not in FOLDERS or ".." in parts:
            raise CorruptError(
                f"the catalogue names the file {relative!r}",
                expected="a path inside the registry",
                do="run `dynreg verify --dry-run`: its catalogue was changed from outside",
            )
        put_here = self.home / relative
        return put_here if self.read_only and put_here.exists() else self.path / relative

    def checked(self, *relative: str) -> list[Path]:
        """Where registered files lie, after their bytes were compared with their hashes.

        A process reads a file for that once, as long as the file stays as it is (about 2 GB/s). Raises CorruptError
        where one is missing, is no regular file, or has other bytes than were registered.
        """
        hashes = self._registered(relative)
        found = [self.locate(name) for name in relative]
        for path, sha256 in zip(found, hashes, strict=True):
            try:
                right = _hash_of(path) == sha256
            except OSError as error:
                raise unreadable(path, error) from error
            if not right:
                raise unreadable(path, "its bytes are not those that were registered")
        return found

    def read_bytes(self, relative: str) -> bytes:
        """A registered file's bytes, compared with their hash; CorruptError where they are lost or changed."""
        (sha256,), path = self._registered([relative]), self.locate(relative)
        try:
            data = read_regular(path)
        except OSError as error:
            raise unreadable(path, error) from error
        if content_hash(data) != sha256:
            raise unreadable(path, "its bytes are not those that were registered")
        return data

    def read_json(self, relative: str) -> dict:
        """A registered JSON document; CorruptError when it is missing or no JSON object."""
        data, path = self.read_bytes(relative), self.locate(relative)
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise unreadable(path, error) from error
        if not isinstance(document, dict):
            raise unreadable(path, "it is not a JSON object")
        return document

    def _registered(self, relative: Iterable[str]) -> list[str]:
        """sha256 of registered files; CorruptError for one that the catalogue does not know."""
        table, known = tables.files, {}
        names = list(relative)
        with self.catalog.read() as connection:
            for at in range(0, len(names), tables.AT_ONCE):
                among = table.c.path.in_(names[at : at + tables.AT_ONCE])
                known.update(connection.execute(select(table.c.path, table.c.sha256).where(among)).all())
        missing = [name for name in names if name not in known]
        if missing:
            raise unreadable(self.path / missing[0], "the catalogue does not know its hash")
        return [known[name] for name in names]


def _hash_of(path: Path) -> str:
    """sha256 of a regular file's bytes, read once as long as the file stays as it is; OSError where it is none."""
    before = _identity(path)
    if before not in _CHECKED:
        sha256 = sha256_of(path)
        if _identity(path) != before:
            return sha256
        _CHECKED[before] = sha256
    return _CHECKED[before]


def _identity(path: Path) -> Identity:
    told = path.lstat()
    return told.st_dev, told.st_ino, told.st_size, told.st_mtime_ns, told.st_ctime_ns

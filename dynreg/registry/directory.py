"""The registry as a directory: its marker, its folders, and its files, each compared with its hash before use.

The files of a shared registry lie in a bucket. Its directory is then the local copy of those that were read or written
here, under the same names.
"""

import json
import shutil
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath

from sqlalchemy import Connection, select

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError
from dynreg.registry.bucket import Bucket, Remote
from dynreg.registry.catalog import Catalog
from dynreg.registry.files import (
    FOLDERS,
    LOCKS,
    StoredFile,
    content_hash,
    in_use,
    is_temporary,
    read_regular,
    sha256_of,
    try_lock,
    unreadable,
    write_file,
)
from dynreg.registry.reaching import lost
from dynreg.registry.served import ServedCatalog
from dynreg.registry.server import let_idle, persistent
from dynreg.registry.sweeping import remove_files, size_of
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
    alone : whether no other process has the folder open now; of one that may be written.
    bucket : where the files of a shared registry lie; None where they lie in `path` itself.
    """

    def __init__(
        self,
        path: Path,
        catalog: Catalog | ServedCatalog,
        home: Path | None = None,
        made: bool = False,
        bucket: Bucket | None = None,
    ):
        self.path = path
        self.home = home or path
        self.catalog = catalog
        self.made = made
        self.bucket = bucket
        self._held = ExitStack()
        if self.read_only:  # for as long as the lock is held, `gc` leaves the folder alone
            self._held.enter_context(try_lock(self.home, create=False))
        else:
            self.alone = self._held.enter_context(in_use(path))

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
        here = self.is_here(file)
        if not here:
            write_file(self.home / file.path, data)
        elif not self.read_only:  # whoever wrote it may have been cut short before its name was synced
            disk.sync_folder((self.home / file.path).parent)
        self.push(file.path, data, anew=not here)

    def register(self, writing: Writing, file: StoredFile, data: bytes) -> None:
        """Enter a staged file into the catalogue, inside the caller's transaction."""
        if not self.locate(file.path).exists():  # a repair took it for an orphan in the meantime
            write_file(self.home / file.path, data)
        self.push(file.path, data)
        writing.put(tables.files, {"path": file.path, "sha256": file.sha256, "size": file.size})

    def push(self, relative: str, data: bytes, anew: bool = False) -> None:
        """Bring a file to the bucket, where there is one that lacks it; `anew` where it may hold other bytes."""
        if self.bucket is not None and (anew or self.bucket.size(relative) != len(data)):
            self.bucket.write(relative, data)

    def holds(self, file: StoredFile) -> bool:
        """True when the file is stored with exactly these bytes."""
        if self.bucket is not None and self.bucket.size(file.path) != file.size:
            return False
        return self.is_here(file)

    def is_here(self, file: StoredFile) -> bool:
        """True when the file lies here with exactly these bytes, brought from the bucket where there is one."""
        if self.bucket is not None and not self._lies_here(file):
            with suppress(CorruptError):
                self._pull(file.path, file.sha256)
        return self._lies_here(file)

    def _lies_here(self, file: StoredFile) -> bool:
        with suppress(OSError):
            return _hash_of(self.locate(file.path)) == file.sha256
        return False

    def _lies_here_as_named(self, path: Path) -> bool:
        with suppress(OSError):
            return path.stem.endswith(f"-{_hash_of(path)[:16]}")
        return False

    def _pull(self, relative: str, sha256: str) -> None:
        """Bring a file from the bucket, if its bytes are right; CorruptError else."""
        try:
            data = self.bucket.read(relative)
        except FileNotFoundError as error:
            raise lost(relative, error) from error
        if content_hash(data) != sha256:
            raise lost(relative, "its bytes are not those that were registered")
        path = self.locate(relative)
        disk.make_folder(path.parent)
        write_file(path, data)

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
        files = self._registered(relative)
        found = [self.locate(name) for name in relative]
        for path, file in zip(found, files, strict=True):
            sha256 = file.sha256
            if self.bucket is not None and not self._lies_here(file):
                self._pull(file.path, sha256)
            try:
                right = _hash_of(path) == sha256
            except OSError as error:
                raise unreadable(path, error) from error
            if not right:
                raise unreadable(path, "its bytes are not those that were registered")
        return found

    def read_bytes(self, relative: str) -> bytes:
        """A registered file's bytes, compared with their hash; CorruptError where they are lost or changed."""
        (file,), path = self._registered([relative]), self.locate(relative)
        if self.bucket is not None:
            self.checked(relative)
        try:
            data = read_regular(path)
        except OSError as error:
            raise unreadable(path, error) from error
        if content_hash(data) != file.sha256:
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

    def near(self, *relative: str) -> list[Path | Remote]:
        """Where registered files are read in part: here, `checked`; or in the bucket, where they are not here yet.

        Of what is read in part there no hash is known: who reads it has to know what it must be.
        """
        if self.bucket is None:
            return list(self.checked(*relative))
        files = self._registered(relative)
        return [
            self.locate(file.path) if self._lies_here(file) else Remote(self.bucket, file.path, file.size)
            for file in files
        ]

    def brought(self, name: str) -> Path:
        """Where a file lies that the catalogue does not know; brought from the bucket, by the hash in its name."""
        path = self.locate(name)
        if self.bucket is not None and not self._lies_here_as_named(path):
            with suppress(FileNotFoundError):  # removed meanwhile: whoever reads it finds none
                write_file(path, self.bucket.read(name))
        return path

    def names(self, folder: str) -> list[str]:
        """Names of all files below a folder of the registry, links among them: those first that were put here."""
        if self.bucket is not None:
            return sorted(self.bucket.names(folder))
        found: dict[str, None] = {}
        for home in dict.fromkeys((self.home, self.path)):
            files = (p for p in (home / folder).rglob("*") if p.is_symlink() or not p.is_dir())
            names = (p.relative_to(home).as_posix() for p in files if not is_temporary(p.name))
            found |= dict.fromkeys(sorted(names))
        return list(found)

    def size(self, name: str) -> int:
        """Bytes of a file, or of a folder where its name ends in "/"; 0 where there is none."""
        if self.bucket is None:
            return size_of(self.path / name)
        return (
            sum(self.bucket.names(name[:-1]).values()) if name.endswith("/") else self.bucket.size(name) or 0
        )

    def remove(self, names: Iterable[str]) -> None:
        """Remove files, and whole folders where a name ends in "/"; what is gone already is no error."""
        names = list(names)
        remove_files(self.home, names)
        if self.bucket is not None:
            for name in names:
                for one in self.bucket.names(name[:-1]) if name.endswith("/") else [name]:
                    self.bucket.remove(one)

    def take_time(self, connection: Connection) -> None:
        """Keep a transaction on a server, and its lock, for as long as many files of the bucket are read or removed."""
        if self.bucket is not None:
            let_idle(connection)

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Hold the lock of a name for a block; False where another process, or another machine, holds it."""
        if isinstance(self.catalog, ServedCatalog):
            return self.catalog.claim(name)
        return _file_lock(self.home / LOCKS / f"{name}.lock")

    @persistent
    def _registered(self, relative: Iterable[str]) -> list[StoredFile]:
        """Registered files by their names; CorruptError for one that the catalogue does not know."""
        table, known = tables.files, {}
        names = list(relative)
        with self.catalog.read() as connection:
            for at in range(0, len(names), tables.AT_ONCE):
                among = table.c.path.in_(names[at : at + tables.AT_ONCE])
                rows = connection.execute(select(table.c.path, table.c.sha256, table.c.size).where(among))
                known |= {row.path: StoredFile(*row) for row in rows}
        missing = [name for name in names if name not in known]
        if missing:
            raise unreadable(self.path / missing[0], "the catalogue does not know its hash")
        return [known[name] for name in names]


@contextmanager
def _file_lock(path: Path) -> Iterator[bool]:
    with try_lock(path) as mine:
        try:
            yield mine
        finally:
            if mine:
                disk.remove(path)


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

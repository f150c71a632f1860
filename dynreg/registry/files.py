"""Files that survive a crash: written under a temporary name, synced, renamed; named by what they hold."""

import errno
import glob
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import dynreg.registry.disk as disk
from dynreg.errors import CorruptError, LimitError, RegistryError, UsageError

CONTENTS = ("shards", "populations", "recordings", "robots", "measured", "simulators", "results")
INDEX = "index"  # what indexes computed; the catalogue knows nothing of it
LEDGER = "ledger"  # what was put, in order
FOLDERS = (*CONTENTS, INDEX, LEDGER)
ROBOTS = "robots"
LOCKS = "locks"
CACHE = "cache"  # what can be computed again; the catalogue knows nothing of it
SEARCHES = "searches"  # journals of searches that have not ended
LOST_AND_FOUND = "lost+found"
_TEMPORARY = ".tmp-"
# What the system says of a name that is gone, or of a link, folder or pipe in its place; None: what we say of it.
_NO_SUCH_FILE = (None, errno.ENOENT, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.ENXIO)


@dataclass(frozen=True)
class StoredFile:
    """One file as the catalogue knows it: path in the registry, sha256, size in bytes (0 where no one asks)."""

    path: str
    sha256: str
    size: int = 0


def content_name(folder: str, stem: str, data: bytes, suffix: str) -> StoredFile:
    """The name under which `data` is stored: it ends in the data's own hash, so no two contents meet."""
    digest = content_hash(data)
    return StoredFile(f"{folder}/{stem}-{digest[:16]}.{suffix}", digest, len(data))


def content_hash(data: bytes) -> str:
    """Hash of bytes, 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def open_regular(path: Path) -> BinaryIO:
    """A file opened for reading; OSError for a link, a folder, a pipe or a device, which no registry holds."""
    flags = os.O_RDONLY | disk.FLAGS | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    stream = open(path, "rb", opener=lambda name, _: os.open(name, flags))
    if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        stream.close()
        raise OSError(f"{path.name!r} is no regular file")
    return stream


def read_regular(path: Path, most: int = -1) -> bytes:
    """All bytes of a regular file, or the first `most`; OSError as `open_regular` raises it."""
    with open_regular(path) as stream:
        return stream.read(most)


def sha256_of(path: Path) -> str:
    """Hash of a regular file's bytes, 64 hexadecimal digits; OSError where it is none."""
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_file(path: Path, data: bytes) -> None:
    """Put `data` at `path` so that a reader or a crash sees all of it or nothing.

    Raises RegistryError when the place cannot be written.
    """
    try:
        while not _write_once(path, data):
            pass
    except OSError as error:
        raise disk.refused("write", path, error) from error


def _taken(path: Path) -> UsageError:
    """What is said of a name that something new was to have, and something has."""
    return UsageError(
        f"{str(path)!r} exists already",
        expected="a name that is not taken",
        do="name another one, or remove what is there",
    )


def unwritten(path: Path, why: str, new: bool = False) -> UsageError:
    """What is said of a place that cannot be written; new : where the name must be free, too."""
    name = "a name that is not taken," if new else "a name"
    return UsageError(
        f"cannot write {str(path)!r}: {why}",
        expected=f"{name} in an existing folder that may be written, with room left",
        do="name another one",
    )


def require_new(path: Path) -> None:
    """UsageError for a name that is taken, or whose folder is not there."""
    if os.path.lexists(path):
        raise _taken(path)
    if not path.absolute().parent.is_dir():
        raise unwritten(path, os.strerror(errno.ENOENT), new=True)


def temporary_name(path: Path) -> Path:
    """A hidden name beside `path` that no other writer uses."""
    return path.with_name(f".{path.name}{_TEMPORARY}{secrets.token_hex(6)}")


@contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """A new folder under a hidden name beside `path`, which goes with the block; a killed one is swept by the next."""
    with ExitStack() as held:
        while True:
            place = temporary_name(path)
            try:
                disk.make_folder(place)
            except RegistryError as error:  # told of the name that the user knows
                if isinstance(error.__cause__, OSError):
                    raise disk.refused("write", path, error.__cause__) from error
                raise
            if held.enter_context(try_lock(place, create=False)):
                break  # else it was swept in the instant between its creation and its lock
        try:
            yield place
        finally:
            shutil.rmtree(place, ignore_errors=True)


def sweep_beside(path: Path) -> None:
    """Remove the temporary files and folders beside `path` whose writers are gone."""
    for found in path.parent.glob(f".{glob.escape(path.name)}{_TEMPORARY}*"):
        _remove_unlocked(found)


def is_temporary(name: str) -> bool:
    """True for the names that `temporary_name` gives."""
    return name.startswith(".") and _TEMPORARY in name


def is_litter(name: str) -> bool:
    """True for names of files that a file manager, of macOS or of Windows, leaves in a folder that it shows."""
    return name in (".DS_Store", "Thumbs.db", "desktop.ini") or name.startswith("._")


def is_passed_over(name: str) -> bool:
    """True for litter by its path in a registry: but for names that a robot's own file may have, it stays unread."""
    folder, *_, file = name.split("/")
    return is_litter(file) and (folder != ROBOTS or file.startswith("."))


def is_content(name: str) -> bool:
    """True for the names of what a user or dynreg keeps in a folder: neither temporary files nor litter."""
    return not is_temporary(name) and not is_litter(name)


def sweep(root: Path) -> int:
    """Remove the temporary files and folders of writers that are gone; returns how many.

    A living writer holds a lock on its file, so its work is left alone.
    """
    return sum(map(_remove_unlocked, _temporaries(root)))


def abandoned(root: Path) -> list[Path]:
    """The temporary files and folders that `sweep` would remove."""
    found = []
    for path in _temporaries(root):
        if not path.is_symlink() and path.exists():
            with try_lock(path, create=False) as mine:
                found += [path] if mine else []
    return found


def _temporaries(root: Path) -> list[Path]:
    found = [*root.glob(f".*{_TEMPORARY}*")]
    for folder in (*FOLDERS, CACHE):
        if not (root / folder).is_symlink():
            found += (root / folder).rglob(f".*{_TEMPORARY}*")
    return found


@contextmanager
def try_lock(path: Path, create: bool = True) -> Iterator[bool]:
    """Hold the lock of a file for the block; False where another process holds it.

    The operating system lets the lock go when its process ends, however it ends.
    """
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | (os.O_CREAT if create else 0)
    try:
        descriptor = os.open(path, flags | disk.FLAGS, 0o644)
    except FileNotFoundError:
        yield False
        return
    except OSError as error:
        raise disk.refused("lock", path, error) from error
    try:
        try:
            disk.lock(descriptor, wait=False)
        except BlockingIOError:
            yield False
            return
        except OSError as error:
            raise disk.refused("lock", path, error) from error
        # The holder before us may have removed the name between our open and our lock.
        yield _same_file(descriptor, path)
    finally:
        os.close(descriptor)


@contextmanager
def in_use(folder: Path) -> Iterator[Callable[[], bool]]:
    """Tell others for the block that a folder is in use; gives a function: whether this block alone uses it now.

    Where folders cannot be locked nobody is told, and no block takes itself to be alone.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | disk.FLAGS)
    except OSError:
        yield lambda: False
        return

    def alone() -> bool:
        with suppress(OSError):
            disk.lock(descriptor, wait=False)
            return True
        return False

    try:
        with suppress(OSError):
            disk.lock(descriptor, wait=False, shared=True)
        yield alone
    finally:
        os.close(descriptor)


def unreadable(path: object, error: Exception | str) -> RegistryError:
    """The error for a stored file that cannot be read: a CorruptError, unless it is the disk or a right that fails.

    path : of the file, or what prints as where it lies.

    Raises `error` itself where it tells of no damage: a sound file may ask for more than a limit or the memory allows.
    """
    if isinstance(error, LimitError | MemoryError):
        raise error
    if isinstance(error, OSError) and error.errno not in _NO_SUCH_FILE:
        return RegistryError(
            f"{str(path)!r} cannot be read: {error.strerror}",
            expected="a disk that reads, and the right to read",
            do="look after the disk, or mend the permissions; nothing was changed",
        )
    told = (error.strerror if isinstance(error, OSError) else None) or str(error).rstrip(": ")
    return CorruptError(
        f"{str(path)!r} cannot be read: {told}",
        expected="the file as it was registered",
        do="run `dynreg verify --repair` to see what is lost and what can be rebuilt",
    )


def _remove_unlocked(path: Path) -> bool:
    if path.is_symlink() or not (path.is_file() or path.is_dir()):
        return False
    with try_lock(path, create=False) as mine:
        if mine and path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        elif mine:
            disk.remove(path)
    return mine


def _write_once(path: Path, data: bytes) -> bool:
    temporary = temporary_name(path)
    descriptor = disk.create(temporary)
    try:
        disk.lock(descriptor)
        disk.write(descriptor, data)
        disk.sync(descriptor)
        disk.rename(temporary, path)
    except FileNotFoundError:
        return False  # swept in the instant between its creation and its lock
    except BaseException:
        with suppress(RegistryError):  # the first error says why
            disk.remove(temporary)
        raise
    finally:
        os.close(descriptor)
    disk.sync_folder(path.parent)
    return True


def _same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False

"""The one place where the registry's code changes the disk, so that a test can record a change or let it fail.

What cannot be done to a name raises NoPlaceError in one line. `create`, `write` and `sync` raise OSError: they work
for `files.write_file`, which tells of the file as a whole.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dynreg.errors import NoPlaceError

# Bytes as they are, and no child process that holds them: each where the system knows of it.
FLAGS = sum(getattr(os, name, 0) for name in ("O_BINARY", "O_CLOEXEC"))


def refused(what: str, path: Path, error: OSError) -> NoPlaceError:
    """The error for `what` cannot be done to `path`."""
    return NoPlaceError(
        f"cannot {what} {str(path)!r}: {error.strerror or error}",
        expected="a place that may be written, with room left, on a disk that works",
        do="free some space, mend its permissions, or name another place, then run the same command again",
    )


def create(path: Path) -> int:
    """A descriptor for writing a file that is new; FileExistsError where the name is taken."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | FLAGS, 0o666)


def lock(descriptor: int, wait: bool = True, shared: bool = False) -> None:
    """Hold the lock of an open file or folder until it is closed; without `wait`, BlockingIOError if another has it.

    shared : hold it together with others that share it; a later call for this descriptor changes how it is held.
    Raises OSError where it cannot be locked, as on a file system without locks.
    """
    from portalocker import AlreadyLocked, LockException, LockFlags
    from portalocker import lock as take  # imported here: it wants a module of the system's own

    try:
        how = LockFlags.SHARED if shared else LockFlags.EXCLUSIVE
        take(descriptor, how | (LockFlags(0) if wait else LockFlags.NON_BLOCKING))
    except AlreadyLocked as problem:
        raise BlockingIOError(str(problem)) from None
    except LockException as problem:
        code = getattr(problem.__cause__, "errno", None) or errno.ENOLCK
        raise OSError(code, os.strerror(code)) from problem


def write(descriptor: int, data: bytes) -> None:
    """Write all of `data` where the descriptor stands."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def sync(descriptor: int) -> None:
    """Bring a file's bytes to the disk; they outlast a power cut when this returns."""
    os.fsync(descriptor)


def rename(old: Path, new: Path) -> None:
    """Give a file or folder another name, in place of a file that has it; FileNotFoundError where it is gone."""
    try:
        os.replace(old, new)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise refused("rename to", new, error) from error


def remove(path: Path) -> None:
    """Remove a file's name; nothing where it is gone already."""
    with _telling("remove", path):
        path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Remove an empty folder."""
    with _telling("remove", path):
        path.rmdir()


def make_folder(path: Path) -> None:
    """Make a folder where there is none, and bring its name to the disk; parents are made likewise."""
    if path.is_dir():
        return
    make_folder(path.parent)
    with _telling("create", path):
        try:
            path.mkdir()
        except FileExistsError:  # another process was quicker, or something else has the name
            if not path.is_dir():
                raise
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk; what was renamed or removed there stays so through a power cut.

    Windows opens no folder; it keeps a log of such changes itself.
    """
    if os.name == "nt":
        return
    with _telling("sync", path):
        descriptor = os.open(path, os.O_RDONLY | FLAGS)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def _telling(what: str, path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise refused(what, path, error) from error

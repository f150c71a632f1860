"""Files and folders that a user named for an answer: whole or not there, also where a run is killed."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dynreg.errors import RegistryError, UsageError
from dynreg.registry.files import sweep_beside, taken, temporary_folder, write_file


def write_out(path: Path, data: bytes) -> None:
    """Put `data` at `path`, in place of what is there; what killed runs left beside it is removed.

    A link is followed. A pipe or a terminal is written to as it is.
    Raises UsageError where the place cannot be written.
    """
    try:
        if path.exists() and not path.is_file():
            with open(path, "wb") as stream:
                stream.write(data)
        else:
            target = Path(os.path.realpath(path))
            sweep_beside(target)
            write_file(target, data)
    except OSError as error:
        raise _unwritten(path, _why(error)) from error
    except RegistryError as error:
        raise _unwritten(path, error.problem.rpartition(": ")[2]) from error


def require_new(path: Path) -> None:
    """UsageError for a name that is taken, or whose folder is not there."""
    if os.path.lexists(path):
        raise taken(path)
    if not path.absolute().parent.is_dir():
        raise _unwritten(path, os.strerror(errno.ENOENT), new=True)


def write_new(path: Path, data: bytes) -> None:
    """Write a file that is not there yet; UsageError where one is, or the place cannot be written."""
    require_new(path)
    write_out(path, data)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """The name of a folder to make in the block: it becomes `path` where the block ends well, else nothing is left.

    Raises UsageError where `path` is taken or cannot be written.
    """
    require_new(path)
    try:
        sweep_beside(path.absolute())
        with temporary_folder(path.absolute()) as hidden:
            yield hidden / "made"
            os.rename(hidden / "made", path)
    except OSError as error:
        raise _unwritten(path, _why(error), new=True) from error


@contextmanager
def new_file_of(path: Path) -> Iterator[Path]:
    """A folder to fill in the block: its file `path.name` becomes `path`, others whose names begin so stand beside it.

    Those go first, so that what is at `path` is whole. Raises UsageError where a name is taken (but by the same bytes,
    which a killed run may have left beside it) or cannot be written.
    """
    require_new(path)
    moved: list[Path] = []
    try:
        sweep_beside(path.absolute())
        with temporary_folder(path.absolute()) as hidden:
            yield hidden
            for file in sorted(hidden.iterdir(), key=lambda file: (file.name == path.name, file.name)):
                target = path.with_name(file.name)
                if not (target != path and target.is_file() and target.read_bytes() == file.read_bytes()):
                    require_new(target)
                    os.rename(file, target)
                    moved.append(target)
    except BaseException as error:
        for target in moved:
            target.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise _unwritten(path, _why(error), new=True) from error
        raise


def _why(error: OSError) -> str:
    """What the system says; Arrow tells its own words around that."""
    return str(error) if error.errno is None else os.strerror(error.errno)


def _unwritten(path: Path, why: str, new: bool = False) -> UsageError:
    name = "a name that is not taken," if new else "a name"
    return UsageError(
        f"cannot write {str(path)!r}: {why}",
        expected=f"{name} in an existing folder that may be written, with room left",
        do="name another one",
    )

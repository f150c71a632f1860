"""Files and folders that a user named for an answer: whole or not there, also where a run is killed."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dynreg.errors import RegistryError
from dynreg.registry.files import require_new, sweep_beside, temporary_folder, unwritten, write_file


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
        raise unwritten(path, _why(error)) from error
    except RegistryError as error:
        raise unwritten(path, _told(error)) from error


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
        with _hidden(path) as hidden:
            yield hidden / "made"
            os.rename(hidden / "made", path)
    except OSError as error:
        raise unwritten(path, _why(error), new=True) from error


@contextmanager
def new_file_of(path: Path) -> Iterator[Path]:
    """A folder to fill in the block: its file `path.name` becomes `path`, others whose names begin so stand beside it.

    Those go first, so that what is at `path` is whole. Raises UsageError where a name is taken (but by the same bytes,
    which a killed run may have left beside it) or cannot be written.
    """
    require_new(path)
    moved: list[Path] = []
    try:
        with _hidden(path) as hidden:
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
            raise unwritten(path, _why(error), new=True) from error
        raise


@contextmanager
def _hidden(path: Path) -> Iterator[Path]:
    """A folder under a hidden name beside `path`, which goes with the block; UsageError where it cannot be made."""
    with ExitStack() as held:
        try:
            sweep_beside(path.absolute())
            hidden = held.enter_context(temporary_folder(path.absolute()))
        except RegistryError as error:
            raise unwritten(path, _told(error), new=True) from error
        yield hidden


def _told(error: RegistryError) -> str:
    """What the system said of a place, without the place: an error of the registry ends with it."""
    return error.problem.rpartition(": ")[2]


def _why(error: OSError) -> str:
    """What the system says; Arrow tells its own words around that."""
    return str(error) if error.errno is None else os.strerror(error.errno)

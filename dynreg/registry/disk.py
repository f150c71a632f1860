"""The one place where the registry's code changes the disk, so that a test can record a change or let it fail."""

import os
from pathlib import Path


def create(path: Path) -> int:
    """A descriptor for writing a file that is new; FileExistsError where the name is taken."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)


def write(descriptor: int, data: bytes) -> None:
    """Write all of `data` where the descriptor stands."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def sync(descriptor: int) -> None:
    """Bring a file's bytes to the disk; they outlast a power cut when this returns."""
    os.fsync(descriptor)


def rename(old: Path, new: Path) -> None:
    """Give a file or folder another name, in place of a file that has it."""
    os.replace(old, new)


def remove(path: Path) -> None:
    """Remove a file's name; nothing where it is gone already."""
    path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Remove an empty folder."""
    path.rmdir()


def make_folder(path: Path) -> None:
    """Make a folder where there is none, and bring its name to the disk; parents are made likewise."""
    if path.is_dir():
        return
    make_folder(path.parent)
    try:
        path.mkdir()
    except FileExistsError:  # another process was quicker, or something else has the name
        if not path.is_dir():
            raise
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk; renames there outlast a power cut when this returns."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

"""A robot's folder, read once: what is hashed, compiled and copied are the same bytes."""

import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from dynreg.errors import RobotError
from dynreg.limits import limits, refuse

TOML = "robot.toml"
MAPS, PLANS = "maps", "plans"  # log maps, and plans of calibrations, which a robot's hash leaves out
_OPENED = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_BINARY", "O_CLOEXEC", "O_NONBLOCK"))


@dataclass(frozen=True, eq=False)
class Folder:
    """Files by their path below the folder, parted by "/". Names that begin with "." or "__" are none of its own."""

    files: Mapping[str, bytes]

    @cached_property
    def hashed(self) -> dict[str, bytes]:
        """The files that make the robot, in the order of their names: all but `maps/` and `plans/`."""
        names = sorted((name for name in self.files if is_hashed(name)), key=lambda name: name.split("/"))
        return {name: self.files[name] for name in names}

    @cached_property
    def hash(self) -> str:
        """sha256 over names and bytes of the files that make the robot."""
        digest = hashlib.sha256()
        for name, data in self.hashed.items():
            digest.update(name.encode() + b"\0" + data + b"\0")
        return digest.hexdigest()

    def write(self, path: Path) -> None:
        """Write the files below `path`; folders are made where they are missing."""
        for name, data in self.files.items():
            (path / name).parent.mkdir(parents=True, exist_ok=True)
            (path / name).write_bytes(data)


def expanded(path: str | Path) -> Path:
    """A path as a user typed it, with `~` for a home, unless a file or folder of that very name is there."""
    typed = Path(path)
    if not str(typed).startswith("~") or typed.exists():
        return typed
    try:
        return typed.expanduser()
    except RuntimeError:  # of a user whom this machine does not know
        return typed


def is_hashed(name: str) -> bool:
    """Whether a robot's hash covers the file with this path below its folder.

    >>> is_hashed("meshes/tip.stl"), is_hashed("maps/log.toml"), is_hashed("__old/model.xml")
    (True, False, False)
    """
    parts = name.split("/")
    return parts[0] not in (MAPS, PLANS) and not any(part.startswith((".", "__")) for part in parts)


def read_folder(path: Path, *, links: bool = False) -> Folder:
    """The files below `path`; `links` are followed only where an installation may be made of them.

    Raises RobotError for a folder that cannot be read, for links, pipes and devices in it, and for more than the
    limits `robot_files` and `robot_bytes` allow.
    """
    files: dict[str, bytes] = {}
    left = limits().robot_bytes
    try:
        for name, file in _files(path, links):
            if len(files) == limits().robot_files:
                refuse(
                    RobotError,
                    f"{str(path)!r} holds too many files",
                    f"more than {len(files)}",
                    "robot_files",
                )
            files[name] = _read(file, left, links)
            left -= len(files[name])
            if left < 0:
                refuse(RobotError, f"{str(path)!r} holds too many bytes", f"with {name!r}", "robot_bytes")
    except OSError as problem:
        raise RobotError(
            f"{problem.filename or str(path)!r} cannot be read: {problem.strerror}",
            expected="a robot folder that can be read",
            do="check the path and its permissions",
        ) from None
    return Folder(files)


def _files(root: Path, links: bool) -> Iterator[tuple[str, Path]]:
    """(name, path) of the files below a folder; what is hidden is passed over."""
    folders = [("", root)]
    while folders:
        prefix, folder = folders.pop()
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda entry: entry.name)
        for entry in entries:
            if entry.name.startswith((".", "__")):
                continue
            name, path = prefix + entry.name, folder / entry.name
            if not _is_text(name):
                raise _not_a_file(path, "has a name that is no text in UTF-8")
            if entry.is_symlink() and not links:
                raise _not_a_file(path, "is a link")
            if entry.is_dir():
                folders.append((f"{name}/", path))
            else:
                yield name, path


def _read(path: Path, most: int, links: bool) -> bytes:
    """The bytes of a file, no more than one above `most`; a pipe or a device is opened, never read."""
    handle = os.open(path, _OPENED | (0 if links else getattr(os, "O_NOFOLLOW", 0)))
    with open(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise _not_a_file(path, "is no file")
        return file.read(most + 1)


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _not_a_file(path: Path, problem: str) -> RobotError:
    return RobotError(
        f"{str(path)!r} {problem}",
        expected="a robot folder of plain files, which its hash covers and the registry copies",
        do="put the file itself there, or take it out of the folder",
    )

"""Every change that a registry makes to a folder of the disk, in order: Python's by `os`, SQLite's by its VFS.

`dynreg.registry.disk` is the one place where the registry's own code changes the disk, and all that it does goes
through the functions of `os` that are exchanged here. That nothing went another way is seen by comparing the folder
with what the changes make of its beginning (`replay.Journal.last`).
"""

import errno
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import sqlite_vfs

GROWING = (
    "create",
    "write",
    "folder",
    "rename",
    "sync",
    "sync_folder",
    "memory",
)  # what a full disk may refuse
SHARED = "-shm"  # in the names of files by which SQLite shares memory: they are not meant to last


@dataclass(frozen=True)
class Change:
    """One change; paths are relative to the folder that is watched.

    `kind` is "create", "write", "truncate" (to `offset`), "sync" (all of a file), "rename" (to `new`), "remove",
    "folder", "sync_folder" (the names in it); or a mark: "begin" and "done" of the step in `path`.
    `file` is the number of the file, which it keeps when it is renamed.
    """

    kind: str
    path: str
    file: int = 0
    offset: int = 0
    data: bytes = b""
    new: str = ""


@dataclass(frozen=True)
class Fault:
    """The change that fails, counted from 0, with which errno, and whether all after it that need room fail, too.

    kinds : the changes that need room: those that a full disk refuses.
    """

    at: int
    code: int
    lasting: bool = False
    kinds: tuple[str, ...] = GROWING

    def hits(self, number: int, kind: str) -> bool:
        """Whether this change is refused."""
        needs_room = kind in self.kinds or self.code != errno.ENOSPC
        return needs_room and (number == self.at or (self.lasting and number > self.at))


@dataclass
class Recorder:
    """What is watched: a folder; what it held in the beginning; what was done to it since."""

    root: Path
    fault: Fault | None = None
    changes: list[Change] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)  # of the changes that could have been refused
    refused: int = 0
    _numbers: dict[tuple[int, int], int] = field(default_factory=dict)  # of files, by their inodes
    _last: int = 0
    _folders: dict[int, str] = field(default_factory=dict)  # paths of folders that are open, by descriptor

    def __post_init__(self) -> None:
        self.root = Path(os.path.realpath(self.root))
        self.start: dict[str, tuple[int, bytes] | None] = {}  # files with number and bytes, None for folders
        for path in sorted(path for path in self.root.rglob("*") if SHARED not in path.name):
            self.start[self.relative(path)] = (
                None if path.is_dir() else (self._number(path), path.read_bytes())
            )

    def allow(self, kind: str, path: str) -> None:
        """Count a change that is about to happen; OSError where it is the one to refuse."""
        if self.relative(path) is None:
            return
        self.kinds.append(kind)
        if self.fault is not None and self.fault.hits(len(self.kinds) - 1, kind):
            self.refused += 1
            raise OSError(self.fault.code, os.strerror(self.fault.code), str(path))

    def note(
        self, kind: str, path: str, file: int = 0, offset: int = 0, data: bytes = b"", new: str = ""
    ) -> int:
        """A change has happened; returns the number of the file."""
        below = self.relative(path)
        if below is not None:
            if kind == "create":
                file = self._number(path)
            self.changes.append(
                Change(kind, below, file, offset, data, self.relative(new) or "" if new else "")
            )
        return file

    def mark(self, kind: str, step: str) -> None:
        """Note where a step begins or is done."""
        self.changes.append(Change(kind, step))

    def file_at(self, path: str) -> int:
        """The number of the file that has this name now; 0 for one that is not watched."""
        return self._numbers.get(_inode(os.stat(path)), 0)

    def open_file(self, descriptor: int) -> int:
        """The number of an open file; 0 for one that is not watched."""
        return self._numbers.get(_inode(os.fstat(descriptor)), 0)

    def relative(self, path: str | Path) -> str | None:
        """The path below the watched folder, "." for itself; None outside, and for SQLite's shared memory."""
        below = os.path.relpath(os.path.join(os.getcwd(), path), self.root)
        return None if below.startswith("..") or SHARED in below else below

    def _number(self, path: str | Path) -> int:
        self._last += 1
        self._numbers[_inode(os.stat(path))] = self._last
        return self._last

    def resolved(self, path: str | Path | int, folder: int | None = None) -> str:
        """A path as `os` functions take it, with the descriptor of the folder that it may be relative to."""
        if isinstance(path, int):
            return self._folders.get(path, "/nowhere")
        path = os.fspath(path)
        return os.path.join(self._folders.get(folder, "/nowhere"), path) if folder is not None else path


@contextmanager
def recording(recorder: Recorder) -> Iterator[Recorder]:
    """In the block, all changes below the recorder's folder are noted (or refused)."""
    saved = {name: getattr(os, name) for name in _REPLACED}
    try:
        for name, replace in _REPLACED.items():
            setattr(os, name, replace(recorder, saved[name]))
        with sqlite_vfs.watched(recorder):
            yield recorder
    finally:
        for name, function in saved.items():
            setattr(os, name, function)


def _inode(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def _open(recorder: Recorder, real: Callable) -> Callable:
    def open(path, flags, mode=0o777, *, dir_fd=None):
        place = recorder.resolved(path, dir_fd)
        new = bool(flags & os.O_CREAT) and not os.path.lexists(place)
        if new:
            recorder.allow("create", place)
        descriptor = real(path, flags, mode, dir_fd=dir_fd)
        if new:
            recorder.note("create", place)
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            recorder._folders[descriptor] = place
        return descriptor

    return open


def _write(recorder: Recorder, real: Callable) -> Callable:
    def write(descriptor, data):
        number = recorder.open_file(descriptor)
        if not number:
            return real(descriptor, data)
        offset = os.lseek(descriptor, 0, os.SEEK_CUR)
        try:
            recorder.allow("write", str(recorder.root))
        except OSError:
            half = bytes(data[: len(data) // 2])  # a write that fails may have done a part of its work
            recorder.note("write", str(recorder.root), number, offset, half[: real(descriptor, half)])
            raise
        written = real(descriptor, data)
        recorder.note("write", str(recorder.root), number, offset, bytes(data[:written]))
        return written

    return write


def _fsync(recorder: Recorder, real: Callable) -> Callable:
    def fsync(descriptor):
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            kind, place, number = "sync_folder", recorder.resolved(descriptor), 0
        else:
            number = recorder.open_file(descriptor)
            kind, place = "sync", str(recorder.root) if number else "/nowhere"
        recorder.allow(kind, place)
        real(descriptor)
        recorder.note(kind, place, number)

    return fsync


def _ftruncate(recorder: Recorder, real: Callable) -> Callable:
    def ftruncate(descriptor, size):
        number = recorder.open_file(descriptor)
        place = str(recorder.root) if number else "/nowhere"
        recorder.allow("truncate", place)
        real(descriptor, size)
        recorder.note("truncate", place, number, size)

    return ftruncate


def _naming(kind: str) -> Callable:
    def replace(recorder: Recorder, real: Callable) -> Callable:
        def change(path, *rest, dir_fd=None, **more):
            place = recorder.resolved(path, dir_fd)
            if os.path.lexists(place) != (kind == "folder"):  # else it fails by itself
                recorder.allow(kind, place)
            real(path, *rest, **({"dir_fd": dir_fd} if dir_fd is not None else {}), **more)
            recorder.note(kind, place, new=os.fspath(rest[0]) if kind == "rename" else "")

        return change

    return replace


_REPLACED = {
    "open": _open,
    "write": _write,
    "fsync": _fsync,
    "fdatasync": _fsync,
    "ftruncate": _ftruncate,
    "replace": _naming("rename"),
    "rename": _naming("rename"),
    "remove": _naming("remove"),
    "unlink": _naming("remove"),
    "rmdir": _naming("remove"),
    "mkdir": _naming("folder"),
}

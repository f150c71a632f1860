"""SQLite's own changes of the disk, seen one by one: the default VFS with a few of its functions replaced, by ctypes.

The structs are those of sqlite3.h (https://sqlite.org/c3ref/vfs.html, io_methods.html). An open file stays the default
VFS' own; only the table of its methods is exchanged for a copy in which writing, truncating, syncing and growing the
shared memory ask first. All other calls go where they went before.
"""

import ctypes
import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_int, c_int64, c_void_p
from typing import Protocol

OK, CANTOPEN, FULL = 0, 14, 13
IOERR_WRITE, IOERR_FSYNC, IOERR_TRUNCATE, IOERR_DELETE, IOERR_SHMSIZE = (
    10 | n << 8 for n in (3, 4, 6, 10, 19)
)
OPEN_CREATE, OPEN_JOURNALS = (
    0x4,
    0x800 | 0x4000 | 0x80000,
)  # rollback journal, journal of several files, write-ahead log

Open = CFUNCTYPE(c_int, c_void_p, c_void_p, c_void_p, c_int, c_void_p)
Delete = CFUNCTYPE(c_int, c_void_p, c_void_p, c_int)
Write = CFUNCTYPE(c_int, c_void_p, c_void_p, c_int, c_int64)
Truncate = CFUNCTYPE(c_int, c_void_p, c_int64)
Sync = CFUNCTYPE(c_int, c_void_p, c_int)
ShmMap = CFUNCTYPE(c_int, c_void_p, c_int, c_int, c_int, c_void_p)


class Vfs(Structure):
    """`sqlite3_vfs` up to version 3; functions that nobody replaces are plain addresses."""

    _fields_ = [
        ("version", c_int),
        ("file_size", c_int),
        ("longest_path", c_int),
        ("next", c_void_p),
        ("name", c_char_p),
        ("data", c_void_p),
        ("open", Open),
        ("delete", Delete),
        *[(f"other{i}", c_void_p) for i in range(14)],
    ]


class Methods(Structure):
    """`sqlite3_io_methods` up to version 3."""

    _fields_ = [
        ("version", c_int),
        *[(name, c_void_p) for name in ("close", "read")],
        ("write", Write),
        ("truncate", Truncate),
        ("sync", Sync),
        *[(f"other{i}", c_void_p) for i in range(7)],
        ("shm_map", ShmMap),
        *[(f"later{i}", c_void_p) for i in range(5)],
    ]


class Watcher(Protocol):
    """Who is told of each change, and may refuse it beforehand."""

    def allow(self, kind: str, path: str) -> None:
        """Raise OSError to refuse the change."""

    def note(self, kind: str, path: str, file: int = 0, offset: int = 0, data: bytes = b"") -> int:
        """The change has happened; returns the number of the file that a "create" made."""

    def file_at(self, path: str) -> int:
        """The number of the file that has this name now."""


def library() -> ctypes.CDLL:
    """The very SQLite that Python's `sqlite3` uses; OSError where its functions cannot be reached.

    Symbols are looked up through the extension module, so that a library that it is linked against is found, too.
    """
    import _sqlite3

    found = ctypes.CDLL(getattr(_sqlite3, "__file__", None))
    try:
        found.sqlite3_libversion.restype = c_char_p
        found.sqlite3_vfs_find.restype = POINTER(Vfs)
        found.sqlite3_vfs_find.argtypes = [c_char_p]
        found.sqlite3_vfs_register.argtypes = [POINTER(Vfs), c_int]
        found.sqlite3_vfs_unregister.argtypes = [POINTER(Vfs)]
        same = found.sqlite3_libversion().decode() == sqlite3.sqlite_version
    except AttributeError:
        same = False
    if not same:
        raise OSError(
            "this Python's SQLite shows no functions to other code (it is linked into it statically)"
        )
    return found


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """In the block, connections that are opened ask `watcher` before they change a file of its."""
    found = library()
    default = found.sqlite3_vfs_find(None)
    shim = Shim(default, watcher)
    found.sqlite3_vfs_register(ctypes.byref(shim.vfs), 1)
    try:
        yield
    finally:
        found.sqlite3_vfs_unregister(ctypes.byref(shim.vfs))
        _KEPT.append(shim)  # a connection that is still open calls it when it closes


_KEPT: list["Shim"] = []


class Shim:
    """The replaced functions, with what they must remember: the files that are open, by their address."""

    def __init__(self, default: "ctypes._Pointer[Vfs]", watcher: Watcher):
        self.default, self.watcher = default, watcher
        self.opened: dict[int, tuple[str, int, int]] = {}  # path, number, flags
        self.fresh: set[int] = set()  # journals that were not synced since they were opened
        self.tables: dict[int, tuple[Methods, Methods]] = {}  # the default's methods, and ours over them
        self.vfs = Vfs.from_buffer_copy(default.contents)
        self.vfs.name = b"dynreg-watched"
        self.vfs.open, self.vfs.delete = Open(self.open), Delete(self.delete)

    def open(self, vfs: int, name: int | None, file: int, flags: int, out: int | None) -> int:
        path = os.fsdecode(ctypes.string_at(name)) if name else None
        new = path is not None and bool(flags & OPEN_CREATE) and not os.path.exists(path)
        if new:
            try:
                self.watcher.allow("create", path)
            except OSError:
                c_void_p.from_address(file).value = None  # no methods: SQLite does not close it
                return CANTOPEN
        code = self.default.contents.open(ctypes.addressof(self.default.contents), name, file, flags, out)
        if code == OK and path is not None:
            number = self.watcher.note("create", path) if new else self.watcher.file_at(path)
            self.opened[file] = (path, number, flags)
            self.fresh.add(file)
            self.replace_methods(file)
        return code

    def delete(self, vfs: int, name: int, sync_folder: int) -> int:
        path = os.fsdecode(ctypes.string_at(name))
        there = os.path.exists(path)
        try:
            if there:
                self.watcher.allow("remove", path)
        except OSError:
            return IOERR_DELETE
        code = self.default.contents.delete(ctypes.addressof(self.default.contents), name, sync_folder)
        if code == OK and there:
            self.watcher.note("remove", path)
            if sync_folder:
                self.watcher.note("sync_folder", os.path.dirname(path))
        return code

    def replace_methods(self, file: int) -> None:
        """Exchange the table of an open file for ours over the same one."""
        field = c_void_p.from_address(file)
        if field.value not in self.tables:
            theirs = Methods.from_address(field.value)
            ours = Methods.from_buffer_copy(theirs)
            ours.write, ours.truncate, ours.sync = Write(self.write), Truncate(self.truncate), Sync(self.sync)
            if theirs.version >= 2:
                ours.shm_map = ShmMap(self.shm_map)
            self.tables[field.value] = (theirs, ours)
            self.tables[ctypes.addressof(ours)] = (theirs, ours)
        field.value = ctypes.addressof(self.tables[field.value][1])

    def theirs(self, file: int) -> Methods:
        """The default's methods of an open file."""
        return self.tables[c_void_p.from_address(file).value][0]

    def write(self, file: int, buffer: int, size: int, offset: int) -> int:
        path, number, _ = self.opened[file]
        try:
            self.watcher.allow("write", path)
        except OSError as error:
            half = size // 2  # a write that fails may have done a part of its work
            if half and self.theirs(file).write(file, buffer, half, offset) == OK:
                self.watcher.note("write", path, number, offset, ctypes.string_at(buffer, half))
            return FULL if error.errno == errno.ENOSPC else IOERR_WRITE
        code = self.theirs(file).write(file, buffer, size, offset)
        if code == OK:
            self.watcher.note("write", path, number, offset, ctypes.string_at(buffer, size))
        return code

    def truncate(self, file: int, size: int) -> int:
        path, number, _ = self.opened[file]
        try:
            self.watcher.allow("truncate", path)
        except OSError:
            return IOERR_TRUNCATE
        code = self.theirs(file).truncate(file, size)
        if code == OK:
            self.watcher.note("truncate", path, number, size)
        return code

    def sync(self, file: int, flags: int) -> int:
        path, number, opened = self.opened[file]
        try:
            self.watcher.allow("sync", path)
        except OSError:
            return IOERR_FSYNC
        code = self.theirs(file).sync(file, flags)
        if code == OK:
            self.watcher.note("sync", path, number)
            # The default VFS for Unix syncs the folder after the first sync of a journal that it may have made.
            if file in self.fresh and opened & OPEN_CREATE and opened & OPEN_JOURNALS:
                self.watcher.note("sync_folder", os.path.dirname(path))
            self.fresh.discard(file)
        return code

    def shm_map(self, file: int, region: int, size: int, extend: int, out: int) -> int:
        if extend:
            try:
                self.watcher.allow("memory", self.opened[file][0])
            except OSError:
                return IOERR_SHMSIZE
        return self.theirs(file).shm_map(file, region, size, extend, out)

"""MATLAB .mat files of version 5: vectors and the columns of matrices become signals, scalars settings.

The numeric matrices are parsed here, as scipy's reader ends the process on some damaged files.
Format: MathWorks, "MAT-File Format", level 5.
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.columns import from_tables, spread, time_column
from dynreg.data.series import RawLog
from dynreg.errors import LogError

_HEADER = 128  # bytes: 116 of text, subsystem offset, version, endian indicator
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC = range(6, 16)  # array classes double to uint64; the others are cells, structs, text, sparse


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read the vectors and matrices of a .mat file that are as long as its time vector, or a clock beside them.

    Raises LogError for version 7.3 (HDF5) files and for damaged ones.
    """
    budget = Budget(file.name)
    budget.check("whole_bytes", file.size)
    data = file.read()
    if data.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise LogError(
            f"{file.name!r} is a MATLAB 7.3 file, which is not read",
            expected="a version 5 .mat file",
            do="save it with save(file, '-v7') in MATLAB",
        )
    try:
        numeric = dict(_variables(data, budget))
    except (ValueError, KeyError, struct.error, zlib.error) as error:
        raise LogError(
            f"{file.name!r} cannot be read: {error}",
            expected="a whole version 5 .mat file",
            do="save it again",
        ) from error
    metadata = {name: float(value) for name, value in numeric.items() if value.ndim == 0}
    vectors = {name: value for name, value in numeric.items() if value.ndim == 1}
    if not vectors:
        raise LogError(
            f"{file.name!r} holds no vector of numbers: structs, cells, timetables and text are not read",
            expected="a vector a signal, one of them the time",
            do="save the fields of a struct by save(file, '-struct', 'name', '-v7')",
        )
    clock = time_column(file.path, vectors, options)
    arrays = {name: value for name, value in numeric.items() if value.ndim <= 2}
    tables, left = spread(file.name, arrays, clock, options)
    return from_tables(file.path, tables, options, metadata=metadata, left=left)


def _variables(data: bytes, budget: Budget) -> Iterator[tuple[str, np.ndarray]]:
    """Names and squeezed values of the real numeric matrices that are not empty."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:_HEADER])
    if order is None:
        raise ValueError("no endian indicator")
    for kind, body in _elements(memoryview(data)[_HEADER:], order):
        if kind == _COMPRESSED:
            inner = _unpacked(body, budget)
            kind, body = next(_elements(memoryview(inner), order), (0, memoryview(b"")))
        if kind == _MATRIX:
            variable = _matrix(body, order)
            if variable is not None:
                budget.spend("columns")
                budget.spend("numbers", variable[1].size)
                yield variable


def _unpacked(body: memoryview, budget: Budget) -> bytes:
    """What was packed into one variable; all variables together are held, so they are counted together."""
    unpack = zlib.decompressobj()
    inner = unpack.decompress(body, budget.allowed("chunk_bytes"))
    budget.spend("whole_bytes", len(inner))
    if unpack.eof:
        return inner
    if len(inner) >= budget.allowed("chunk_bytes"):
        budget.refuse("chunk_bytes", len(inner) + 1)
    raise ValueError("a variable is cut off")


def _matrix(body: memoryview, order: str) -> tuple[str, np.ndarray] | None:
    parts = _elements(body, order)
    flags = next(parts, (0, b""))[1]
    if len(flags) < 4 or struct.unpack_from(f"{order}I", flags)[0] & 0xFF not in _NUMERIC:
        return None
    shape = np.frombuffer(next(parts, (0, b""))[1], f"{order}i4")
    name = bytes(next(parts, (0, b""))[1]).decode("latin-1")
    kind, numbers = next(parts, (9, b""))
    values = np.frombuffer(numbers, order + _TYPES[kind])
    if np.any(shape < 0) or int(np.prod(shape, dtype=object)) != len(values):
        raise ValueError(f"{name!r} has {len(values)} values for a matrix of {'x'.join(map(str, shape))}")
    if not values.size:
        return None
    # the kind of number is kept: int64 may be nanoseconds, which a float would round
    return name, np.squeeze(values.reshape(shape, order="F").astype(values.dtype.newbyteorder("=")))


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the data elements that lie one after the other."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # the small format: size and type in one word, up to 4 bytes in the next
            kind, size, begin, step = kind & 0xFFFF, kind >> 16, at + 4, 8
        else:
            begin = at + 8
            step = 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if begin + size > len(data) or (step == 8 and size > 8):
            raise ValueError(f"an element of {size} bytes where {len(data) - begin} are left")
        yield kind, data[begin : begin + size]
        at += step

"""NumPy's .npz files: one array a signal, or one row a sample and one column a signal; scalars are settings.

The arrays are taken from the archive here, as numpy's own loader makes room for what a header says before it is read.
Format: NumPy, "NEP 1: a simple file format for NumPy arrays".
"""

import math
import zipfile
from collections.abc import Iterator, Mapping
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.columns import from_tables, spread, time_column
from dynreg.data.series import RawLog
from dynreg.errors import LogError

_PLAIN = "biufmM"  # numbers, dates and spans


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read the arrays of an .npz file that have a row for each stamp of its time, or of a clock beside them.

    The columns of an array (T, n) are "name[0]", ...; where one array of text names n of them also "name[elbow]".
    Raises LogError for damaged files, and for arrays of objects: to read these would run code out of the file.
    """
    budget = Budget(file.name)
    try:
        with file.open() as stream, zipfile.ZipFile(stream) as archive:
            arrays = dict(_arrays(archive, budget))
    except (zipfile.BadZipFile, ValueError, EOFError, OSError, NotImplementedError, RuntimeError) as error:
        raise LogError(
            f"{file.name!r} cannot be read: {error}",
            expected="a whole .npz file of plain arrays",
            do="write it again with numpy.savez",
        ) from error
    numbers = {name: a for name, a in arrays.items() if a.dtype.kind in _PLAIN}
    texts = {name: a for name, a in arrays.items() if a.dtype.kind == "U" and a.ndim == 1}
    vectors = {name: a for name, a in numbers.items() if a.ndim == 1}
    clock = time_column(file.path, vectors, options, tuple(numbers))
    rows = len(vectors[clock])
    tables, left = spread(file.name, numbers, clock, options)
    lists = [list(t) for t in texts.values() if len(t) != rows]
    for of, columns in tables.items():
        # names first: which list of names an array has is told by its width, also where few of its columns are wanted
        every = columns | _by_name(columns, lists)
        tables[of] = {n: c for n, c in every.items() if n in vectors or options.wants_signal(n)}
    return from_tables(
        file.path,
        tables,
        options,
        metadata={name: float(a) for name, a in numbers.items() if a.ndim == 0 and a.dtype.kind in "biuf"},
        left=left,
        labels={name: t.astype(object) for name, t in texts.items() if len(t) == rows},
    )


def _arrays(archive: zipfile.ZipFile, budget: Budget) -> Iterator[tuple[str, np.ndarray]]:
    """Names and arrays; the size of an array is compared with the limits before it is unpacked."""
    members = [m for m in archive.infolist() if m.filename.endswith(".npy")]
    if not members:
        raise ValueError("it holds no arrays")
    budget.check("columns", len(members))
    for member in members:
        budget.check("chunk_bytes", member.file_size)
        budget.spend("whole_bytes", member.file_size)
        with archive.open(member) as stream:
            yield member.filename.removesuffix(".npy"), _array(stream, member)


def _array(stream: BinaryIO, member: zipfile.ZipInfo) -> np.ndarray:
    version = npy.read_magic(stream)
    if version == (1, 0):
        shape, fortran, dtype = npy.read_array_header_1_0(stream)
    elif version in ((2, 0), (3, 0)):
        shape, fortran, dtype = npy.read_array_header_2_0(stream)
    else:
        raise ValueError(f"{member.filename!r} is of version {version}")
    if dtype.hasobject:
        raise ValueError(f"{member.filename!r} holds Python objects, which are not read")
    if dtype.names is not None or dtype.subdtype is not None:
        raise ValueError(f"{member.filename!r} is a structured array; save each field as an array of its own")
    size = math.prod(shape) * dtype.itemsize
    if any(n < 0 for n in shape) or size > member.file_size:
        raise ValueError(f"{member.filename!r} is too short for its shape {shape}")
    values = np.frombuffer(stream.read(size), dtype)
    return values.reshape(shape, order="F" if fortran else "C").astype(dtype.newbyteorder("="))


def _by_name(columns: Mapping[str, np.ndarray], names: list[list[str]]) -> dict[str, np.ndarray]:
    """The columns of lists once more, by the names of the only array of text that has as many."""
    widths: dict[str, int] = {}
    for name in columns:
        if name.endswith("]"):
            widths[name.rpartition("[")[0]] = widths.get(name.rpartition("[")[0], 0) + 1
    out = {}
    for stem, width in widths.items():
        fitting = [told for told in names if len(told) == width]
        for i, told in enumerate(fitting[0] if len(fitting) == 1 else ()):
            out[f"{stem}[{told}]"] = columns[f"{stem}[{i}]"]
    return out

"""MATLAB .mat files of version 5: vectors become signals, scalars settings."""

from pathlib import Path

import numpy as np

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.columns import from_columns, time_column
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError


def read(path: Path, options: ReadOptions) -> RawLog:
    """Read the vectors of a .mat file that are as long as its time vector.

    Raises LogError for version 7.3 (HDF5) files and for damaged ones.
    """
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise LogError(
            f"{path.name!r} is a MATLAB 7.3 file, which is not read",
            expected="a version 5 .mat file",
            do="save it with save(file, '-v7') in MATLAB",
        )
    try:
        variables = loadmat(path, struct_as_record=True)
    except Exception as error:  # scipy raises many kinds for damaged files
        raise LogError(
            f"{path.name!r} cannot be read: {error}",
            expected="a whole version 5 .mat file",
            do="save it again",
        ) from error
    numeric = {
        name: np.squeeze(value)
        for name, value in variables.items()
        if not name.startswith("__")
        and isinstance(value, np.ndarray)
        and value.dtype.kind in "biuf"
        and value.size
    }
    metadata = {name: float(value) for name, value in numeric.items() if value.ndim == 0}
    vectors = {name: value for name, value in numeric.items() if value.ndim == 1}
    rows = len(vectors[time_column(path, vectors, options)])
    columns = {name: value for name, value in vectors.items() if len(value) == rows}
    findings = tuple(
        Finding("info", "left_out", f"{path.name}, {name}", f"{len(value)} values for {rows} time stamps")
        for name, value in vectors.items()
        if len(value) != rows
    )
    return from_columns(path, columns, options, metadata=metadata, findings=findings)

"""From named columns (CSV, Parquet, MATLAB, JSON) to series on the table's own clock."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.readers import ReadOptions
from dynreg.data.series import Finding, RawLog, Series
from dynreg.errors import LogError

TIME_NAMES = ("time", "timestamp", "t", "t_s", "time_s", "stamp", "Time", "T")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def from_columns(
    path: Path,
    columns: Mapping[str, np.ndarray],
    options: ReadOptions,
    *,
    metadata: Mapping[str, Any] | None = None,
    labels: Mapping[str, np.ndarray] | None = None,
    units: Mapping[str, str] | None = None,
    findings: tuple[Finding, ...] = (),
) -> RawLog:
    """A RawLog of equally long columns, one of which is the time.

    Raises LogError where there is no time column, or it holds no number.
    """
    name = time_column(path, columns, options)
    stamps = np.asarray(columns[name])
    finite = stamps[np.isfinite(stamps.astype(float))] if stamps.size else stamps
    if not finite.size:
        raise LogError(
            f"{path.name!r}: the time column {name!r} holds no number",
            expected="a stamp a row",
            do="check the log",
        )
    start, scale = finite[0], TIME_UNITS[options.time_unit]
    # Whole numbers (nanoseconds since 1970) are subtracted before they lose digits as floats.
    time = (stamps - start).astype(float) * scale
    sources = {
        key: Series(time, np.asarray(values, dtype=float), (units or {}).get(key))
        for key, values in columns.items()
        if key != name
    }
    metadata = {**(metadata or {}), "start": float(start) * scale}
    return RawLog(path, sources, metadata, labels or {}, findings)


def time_column(path: Path, columns: Mapping[str, np.ndarray], options: ReadOptions) -> str:
    """Name of the column that is the clock: the map's, else the first of the usual names."""
    wanted = (options.time,) if options.time else TIME_NAMES
    for name in wanted:
        if name in columns:
            return name
    raise LogError(
        f"{path.name!r} has no time column {options.time!r}"
        if options.time
        else f"{path.name!r} has no column that looks like time",
        expected=f"one of its numeric columns {list(columns)[:30]}",
        do='name it in the map: time = "..." under [map]',
    )

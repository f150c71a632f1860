"""Named columns (CSV, Parquet, MATLAB, JSON) become series on the table's own clock."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.numbers import doubles, seconds
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import Finding, RawLog, Series
from dynreg.errors import LogError, one_of
from dynreg.limits import limits, refuse

# Of clocks, in small letters, the likeliest first. __time is PlotJuggler's, _time that of InfluxDB.
TIME_NAMES = (
    *("time", "timestamp", "t", "t_s", "time_s", "stamp", "timestamps", "times", "__time", "_time"),
    *("header.stamp", "header/stamp", "header_stamp"),
)
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Names that tell the unit; a map that names the column tells the unit itself. The first is that of `rostopic echo -p`.
UNIT_NAMES = {"%time": "ns"} | {
    f"{name}_{unit}": unit for unit in ("ms", "us", "ns") for name in ("time", "t", "timestamp", "stamp")
}
_USUAL = (*TIME_NAMES, *UNIT_NAMES)
_BRACKETED = re.compile(r"(?i:time|t|timestamp|stamp)\s*[\[(](s|ms|us|ns)[\])]")


def stated_unit(name: str) -> str | None:
    """The unit that the name of a clock states; None where it states none, or is no clock's.

    >>> stated_unit("time_ms"), stated_unit("Time [s]"), stated_unit("time"), stated_unit("torque [ms]")
    ('ms', 's', None, None)
    """
    found = _BRACKETED.fullmatch(name)
    return found[1] if found else UNIT_NAMES.get(name.lower())


def is_clock(name: str) -> bool:
    """Whether a column's name is a usual one of a clock, in small letters or large ones."""
    return name.lower() in _USUAL or stated_unit(name) is not None


def from_columns(
    path: Path,
    columns: Mapping[str, np.ndarray],
    options: ReadOptions,
    *,
    metadata: Mapping[str, Any] | None = None,
    labels: Mapping[str, np.ndarray] | None = None,
    units: Mapping[str, str] | None = None,
    findings: tuple[Finding, ...] = (),
    names: Sequence[str] = (),
) -> RawLog:
    """A RawLog of equally long columns, one of which is the time.

    `names` are the columns that the table holds, where only some were read.
    A column is an array of numbers, dates or spans; one with empty cells is masked (numpy.ma), or NaN or NaT there.
    Raises LogError where there is no time column, it holds no number, or all are more than may be kept.
    """
    name = time_column(path, columns, options, names)
    stamps = columns[name]
    if len(stamps) * len(columns) > limits().numbers:
        refuse(LogError, f"{path.name!r} asks for {len(stamps)} rows of columns", len(columns), "numbers")
    unit = options.time_unit if options.time else stated_unit(name) or options.time_unit
    scale = TIME_UNITS[unit]
    time, start = seconds(stamps, scale) if len(stamps) else (np.empty(0), math.nan)
    if math.isnan(start):
        raise LogError(
            f"{path.name!r}: the time column {name!r} holds no number",
            expected="a stamp a row",
            do="check the log",
        )
    sources = {
        key: Series(time, doubles(values), (units or {}).get(key))
        for key, values in columns.items()
        if key != name
    }
    return RawLog(
        path,
        sources,
        {**(metadata or {}), "start": start, "time_column": name, "time_unit": unit},
        labels or {},
        findings,
        tuple(names) or tuple(columns),
    )


def time_column(path: Path, columns: Collection[str], options: ReadOptions, names: Sequence[str] = ()) -> str:
    """Name of the column that is the clock: the map's, else the likeliest of the usual names."""
    usual = sorted(filter(is_clock, dict.fromkeys((*columns, *names))), key=_place)
    wanted = [options.time] if options.time else usual
    for name in wanted:
        if name in columns:
            return name
    held = next((name for name in wanted if name in names), None)
    if held is not None:
        raise LogError(
            f"{path.name!r}: the time column {held!r} does not hold numbers",
            expected="numbers with a decimal point in every row below one header line",
            do="export the log so: without a line of units, comments, decimal commas or a second header",
        )
    if options.time:
        told = f"{path.name!r} has no time column {options.time!r}"
    else:
        told = f"{path.name!r} has no column that looks like time"
    raise LogError(
        told,
        expected=f"a column of the file, {one_of([*(names or columns)], options.time or '')}",
        do="rename it to time, or by its unit to time_ms, time_us or time_ns; where a map is asked for, "
        'time = "..." under [map] names it too',
    )


def _place(name: str) -> int:
    """Where the name of a clock stands among the usual ones; a T comes last, for it may be a temperature."""
    plain = name.lower()
    return _USUAL.index(plain) if plain in _USUAL and name != "T" else len(_USUAL) + (name == "T")


def spread(
    name: str, arrays: Mapping[str, np.ndarray], rows: int
) -> tuple[dict[str, np.ndarray], tuple[Finding, ...]]:
    """Arrays of a log `name` as columns of so many rows, and findings about the arrays that are left out.

    An array (rows, n), or (n, rows), is n columns "array[0]", ...; scalars are no columns, and are not told.
    """
    columns: dict[str, np.ndarray] = {}
    findings = []
    for key, array in arrays.items():
        if array.ndim == 2 and array.shape[0] != rows:
            array = array.T
        fits = array.ndim in (1, 2) and len(array) == rows
        if fits and array.ndim == 1:
            columns[key] = array
        elif fits and array.shape[1] <= MAX_ITEMS:
            columns |= {f"{key}[{i}]": array[:, i] for i in range(array.shape[1])}
        elif array.ndim > 0:
            shape = f"{len(array)} values" if array.ndim == 1 else f"shape {array.shape}"
            findings.append(Finding("info", "left_out", f"{name}, {key}", f"{shape} for {rows} time stamps"))
    return columns, tuple(findings)

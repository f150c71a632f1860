"""Named columns (CSV, Parquet, MATLAB, JSON) become series on the table's own clock."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.clock_names import (
    CLOCK_WORDS,
    LONGER,
    UNITS_OF_TIME,
    halves,
    is_clock,
    likelihood,
    longer_unit,
    unit_at_end,
)
from dynreg.data.maps import odd_text
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.numbers import doubles, seconds
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import Finding, RawLog, Series
from dynreg.data.words import words
from dynreg.errors import LISTED, LogError, MapError, one_of
from dynreg.limits import limits, refuse

_DATED = re.compile(r"\d[/.:-]\d+[/.:-]\d|\d:\d")  # of dates and times of day in text


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
    Raises LogError and MapError as `time_column` does, LogError where its unit is not read or all are more than may be
    kept.
    """
    name = time_column(path, columns, options, names, labels)
    stamps = columns[name]
    if len(stamps) * len(columns) > limits().numbers:
        refuse(LogError, f"{path.name!r} asks for {len(stamps)} rows of columns", len(columns), "numbers")
    unit = _unit(name, options)
    told = "map" if options.time_unit else "name" if unit_at_end(name) else ""
    told = "dates" if stamps.dtype.kind in "mM" else told
    if not told:
        _require_unit(path, name)
    scale = UNITS_OF_TIME[unit]
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
    clock = {"start": start, "time_column": name, "time_unit": unit, "time_unit_told": told}
    return RawLog(
        path,
        sources,
        {**(metadata or {}), **clock},
        labels or {},
        findings,
        tuple(names) or tuple(columns),
    )


def time_column(
    path: Path,
    columns: Collection[str],
    options: ReadOptions,
    names: Sequence[str] = (),
    labels: Mapping[str, np.ndarray] | None = None,
) -> str:
    """Name of the column that is the clock: the map's, else the likeliest of the usual names.

    names : of all columns, where `columns` are those that hold numbers. labels : columns of text. Raises MapError where
    the log lacks the map's clock, LogError where it has none or that holds no numbers.
    """
    named = [*dict.fromkeys((*columns, *names))]
    parts = halves(named) or ()
    usual = sorted((name for name in named if is_clock(name) and name not in parts), key=likelihood)
    wanted = [options.time] if options.time else usual
    for name in wanted:
        if name in columns:
            return name
    held = next((name for name in wanted if name in names), None)
    if held is not None:
        raise _no_numbers(path, held, (labels or {}).get(held))
    every = [*(names or columns)]
    if options.time:
        read = next((name for name in usual if longer_unit(name) is None), None)
        without = f", or leave it and `time_unit` out: {read!r} is then the clock" if read else ""
        raise MapError(
            f"{path.name!r} has no column {options.time!r}, which the map names as the clock",
            expected=f"a column of the log, {one_of(every, options.time)}",
            do=f"correct `time` under [map]{without}",
        )
    if parts:
        whole, rest = parts
        raise LogError(
            f"{path.name!r} has its stamps in two columns: {whole!r} holds whole seconds alone, {rest!r} the rest",
            expected="one clock",
            do=f"add the two: {whole} + 1e-9 * {rest}, in a column called time",
        )
    raise LogError(
        f"{path.name!r} has no column that looks like time among {len(every)}: {', '.join(map(repr, every[:LISTED]))}",
        expected="one called time (in seconds), or time_ms, time_us or time_ns",
        do='rename the clock so, or name it in a map: time = "..." under [map]. If the log has none and its rows come '
        "evenly, add a column time: the number of the row times the seconds between two rows",
    )


def _no_numbers(path: Path, name: str, texts: np.ndarray | None) -> LogError:
    """What is said of a clock that holds no numbers; `texts` are its cells, where these are text."""
    first = "" if texts is None else f": {odd_text(texts)}"
    dated = texts is None or _DATED.search(first)
    return LogError(
        f"{path.name!r}: the time column {name!r} does not hold numbers{first}",
        expected="seconds in every row below one header line, with a decimal point, or dates such as "
        "2026-11-29T09:01:02.500",
        do="write the column so, with the fractions of a second by which the rows differ"
        if dated
        else "export the log so: without a line of units, comments, decimal commas or a second header",
    )


def _unit(name: str, options: ReadOptions) -> str:
    """The unit of the clock of this name: the map's, else the one that its name states, else seconds."""
    return options.time_unit or unit_at_end(name) or "s"


def _require_unit(path: Path, name: str) -> None:
    """LogError where the name of a clock states a unit that is not read."""
    longer = longer_unit(name)
    if longer is not None:
        raise LogError(
            f"{path.name!r}: the time column {name!r} counts in {longer}, which is not read",
            expected=f"one of {', '.join(UNITS_OF_TIME)}",
            do=f"multiply it by {LONGER[longer]} and call it time_s",
        )


def spread(
    name: str, arrays: Mapping[str, np.ndarray], clock: str, options: ReadOptions
) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, Finding]]:
    """{clock: columns} of a log's arrays, and {array: finding} of those that are left out.

    An array (rows, n), or (n, rows), is n columns "array[0]", ...; scalars are no columns, and are not told. What is
    not as long as `clock`, which comes first, is on the clock that is as long and is named so, such as cmd_time.
    """
    rows, clocks = len(arrays[clock]), _other_clocks(arrays, clock, options)
    tables = {clock: {clock: arrays[clock]}}
    left = {}
    for key, array in arrays.items():
        alike = [other for other, stamps in clocks.items() if len(stamps) in array.shape[:2]]
        own = clock if rows in array.shape[:2] else max(alike, key=lambda c: _shared(c, key), default=None)
        columns = _columns(key, array, len(arrays[own])) if own and key not in clocks else {}
        if columns:
            tables.setdefault(own, {own: arrays[own]}).update(columns)
        elif array.ndim > 0:
            left[key] = _left_out(name, key, array, clock, rows)
    return tables, {key: found for key, found in left.items() if key not in tables}


def from_tables(
    path: Path,
    tables: Mapping[str, Mapping[str, np.ndarray]],
    options: ReadOptions,
    *,
    metadata: Mapping[str, Any],
    left: Mapping[str, Finding],
    labels: Mapping[str, np.ndarray] | None = None,
) -> RawLog:
    """A RawLog of what `spread` gives: the columns of each clock, and what was left out.

    labels : beside the first clock. Raises LogError as `from_columns` does.
    """
    (clock, _), *others = tables.items()
    names = (*(name for columns in tables.values() for name in columns if name not in tables), *left)
    found = tuple(left.values())
    told = {"metadata": metadata, "labels": labels, "findings": found, "names": names}
    log = from_columns(path, tables[clock], options, **told)
    logs = [log]
    for other, columns in others:
        unit = unit_at_end(other) or _unit(clock, options)
        logs.append(from_columns(path, columns, replace(options, time=other, time_unit=unit)))
    start = min(one.start for one in logs)
    sources = {
        name: replace(series, time=series.time + (one.start - start))
        for one in logs
        for name, series in one.sources.items()
    }
    return replace(log, sources=sources, metadata={**log.metadata, "start": start})


def _other_clocks(
    arrays: Mapping[str, np.ndarray], clock: str, options: ReadOptions
) -> dict[str, np.ndarray]:
    """Arrays that are clocks beside the log's own: by their names, and as they run on and overlap with it."""
    unit, own = _unit(clock, options), arrays[clock]
    begin, end = _ends(own, unit)
    out = {}
    for name, array in arrays.items():
        if array.ndim == 1 and 1 < len(array) != len(own) and not CLOCK_WORDS.isdisjoint(words(name)):
            first, last = _ends(array, unit_at_end(name) or unit)
            if np.all(np.diff(doubles(array)) >= 0) and first < last and first <= end and begin <= last:
                out[name] = array
    return out


def _ends(stamps: np.ndarray, unit: str) -> tuple[float, float]:
    """The least and the largest of stamps [s]; NaN where there is none."""
    times = doubles(stamps) * (1.0 if stamps.dtype.kind in "mM" else UNITS_OF_TIME[unit])
    times = times[np.isfinite(times)]
    return (float(times.min()), float(times.max())) if len(times) else (math.nan, math.nan)


def _shared(one: str, other: str) -> int:
    """How many words two names share."""
    return len({*words(one)} & {*words(other)})


def _columns(key: str, array: np.ndarray, rows: int) -> dict[str, np.ndarray]:
    """The columns of an array that is as long, or as wide, as a clock; none of images, nor of three dimensions."""
    if array.ndim == 1:
        return {key: array}
    if array.ndim == 2 and array.shape[0] != rows:
        array = array.T
    if array.ndim > 2 or array.shape[1] > MAX_ITEMS:
        return {}
    return {f"{key}[{i}]": array[:, i] for i in range(array.shape[1])}


def _left_out(name: str, key: str, array: np.ndarray, clock: str, rows: int) -> Finding:
    """What is said of an array that has no clock; one that is short, as gains are, or a clock itself, is only told."""
    shape = f"{len(array)} values" if array.ndim == 1 else f"shape {array.shape}"
    where, told = f"{name}, {key}", f"{shape} for {rows} time stamps"
    clocked = rows in array.shape[:2] or not CLOCK_WORDS.isdisjoint(words(key))
    if clocked or max(array.shape) <= MAX_ITEMS:
        return Finding("info", "left_out", where, told)
    do = f"resample it onto {clock!r}, or store its clock beside it, such as {key}_time, that overlaps with {clock!r}"
    return Finding("warning", "left_out", where, f"{told}: it is left out", do)

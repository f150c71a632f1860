"""CSV and Parquet tables: one row a sample, one column a signal."""

import csv as text_csv
import json
from pathlib import Path

import numpy as np
import pyarrow as pa

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions, format_of
from dynreg.data.readers.columns import from_columns
from dynreg.data.series import RawLog
from dynreg.errors import LogError

MAX_ITEMS = 64
_TEXT = (pa.types.is_string, pa.types.is_large_string, pa.types.is_dictionary)


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read a CSV (comma, semicolon or tab; a header line) or a Parquet file.

    List columns become "name[0]", "name[1]", ...; text columns are kept as labels; units are taken from the
    `unit` key of Parquet field metadata. Raises LogError for a file that is neither or is damaged.
    """
    import pyarrow.parquet as pq

    try:
        if format_of(file).name == "parquet":
            with file.open() as stream:  # a stream: of a path, a colon would make an address
                table = pq.read_table(stream)
        else:
            table = _read_csv(file)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(
            f"{file.name!r} cannot be read as a table: {error}",
            expected="a header line and equally long rows, or a whole Parquet file",
            do="export the log again",
        ) from error
    if table.num_rows == 0:
        raise LogError(f"{file.name!r} has no rows", expected="at least two samples", do="record it again")
    return from_table(file.path, table, options)


def from_table(path: Path, table: pa.Table, options: ReadOptions) -> RawLog:
    """A RawLog of an Arrow table."""
    columns: dict[str, np.ndarray] = {}
    labels: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for field, column in zip(table.schema, table.columns, strict=True):
        unit = (field.metadata or {}).get(b"unit")
        if any(test(field.type) for test in _TEXT):
            labels[field.name] = np.array([str(v) for v in column.to_pylist()])
            continue
        for name, values in _numbers(field, column):
            columns[name] = values
            if unit is not None:
                units[name] = unit.decode()
    columns.update(_stated_settings(table))
    return from_columns(path, columns, options, labels=labels, units=units)


def _stated_settings(table: pa.Table) -> dict[str, np.ndarray]:
    """The settings of a stored recording, one column each, from its schema's metadata."""
    stated = (table.schema.metadata or {}).get(b"dynreg")
    try:
        episodes = json.loads(stated)["episodes"] if stated else []
        names = sorted({name for e in episodes for name in e["settings"]})
        rows = [int(e["rows"]) for e in episodes]
        if sum(rows) != table.num_rows:
            return {}
        return {n: np.repeat([float(e["settings"].get(n, np.nan)) for e in episodes], rows) for n in names}
    except (KeyError, TypeError, ValueError):
        return {}


def _read_csv(file: LogFile) -> pa.Table:
    from pyarrow import csv

    with file.open() as stream:
        first = stream.readline().decode("utf-8-sig", errors="replace")
    try:
        delimiter = text_csv.Sniffer().sniff(first, delimiters=",;\t").delimiter
    except text_csv.Error:
        delimiter = ","
    with file.open() as stream:
        table = csv.read_csv(
            stream,
            # One thread: block boundaries must not decide a column's type.
            read_options=csv.ReadOptions(use_threads=False),
            parse_options=csv.ParseOptions(delimiter=delimiter),
            convert_options=csv.ConvertOptions(null_values=["", "nan", "NaN", "NA", "null", "None"]),
        )
    return table.rename_columns([name.strip().lstrip("# ") for name in table.column_names])


def _numbers(field: pa.Field, column: pa.ChunkedArray) -> list[tuple[str, np.ndarray]]:
    """The numeric columns that one table column becomes: itself, or one for each item of its lists."""
    kind = field.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        unit = pa.timestamp("ns", kind.tz) if pa.types.is_timestamp(kind) else pa.duration("ns")
        nanos = column.cast(unit).cast(pa.int64())
        return [(field.name, _dense(nanos) * 1e-9 if nanos.null_count else nanos.to_numpy() * 1e-9)]
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
        return _listed(field.name, column)
    if pa.types.is_boolean(kind):
        return [(field.name, _dense(column.cast(pa.int8())))]
    if pa.types.is_integer(kind) and column.null_count == 0:
        return [(field.name, column.to_numpy())]
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        return [(field.name, _dense(column))]
    if pa.types.is_null(kind):
        return [(field.name, np.full(len(column), np.nan))]
    return []


def _dense(column: pa.ChunkedArray) -> np.ndarray:
    return column.cast(pa.float64()).fill_null(float("nan")).to_numpy()


def _listed(name: str, column: pa.ChunkedArray) -> list[tuple[str, np.ndarray]]:
    inner = column.type.value_type
    if not (pa.types.is_floating(inner) or pa.types.is_integer(inner) or pa.types.is_boolean(inner)):
        return []
    rows = column.to_pylist()
    width = max((len(row) for row in rows if row is not None), default=0)
    if not 0 < width <= MAX_ITEMS:
        return []
    out = np.full((len(rows), width), np.nan)
    for i, row in enumerate(rows):
        if row is not None:
            out[i, : len(row)] = [np.nan if v is None else v for v in row]
    return [(f"{name}[{i}]", out[:, i]) for i in range(width)]

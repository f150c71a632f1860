"""Parquet files: one row a sample, one column a signal, read batch by batch."""

import json
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from dynreg.data.logfile import LogFile
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.batches import Columns, is_listed, is_number, is_text
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.numbers import column, doubles
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError

_CELLS = 1 << 22  # numbers of one batch
_ROWS = 1 << 16


def read(file: LogFile, options: ReadOptions) -> RawLog:
    """Read a Parquet file.

    List columns become "name[0]", "name[1]", ...; text columns are kept as labels; units are taken from the `unit` key
    of a field's metadata. Raises LogError for a file that is none or is damaged.
    """
    table = Columns(file.path, Budget(file.name), options)
    try:
        with file.open() as stream:  # a stream: of a path, a colon would make an address
            schema = gather(stream, table)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(
            f"{file.name!r} cannot be read as a table: {error}",
            expected="a whole Parquet file",
            do="export the log again",
        ) from error
    return table.log(_stated_settings(schema.metadata or {}, table))


def gather(stream: BinaryIO, table: Columns) -> pa.Schema:
    """Add the rows of a Parquet file to a table; gives the file's schema.

    What the footer says is held against the limits first, what is met while it is read.
    """
    import pyarrow.parquet as pq

    schema = pq.ParquetFile(stream).schema_arrow
    texts = [about.name for about in schema if is_text(about.type)]
    # text as a dictionary: one long text in a million rows would be a million of them
    file = pq.ParquetFile(stream, read_dictionary=texts, buffer_size=1 << 20)
    meta = file.metadata
    groups = [meta.row_group(i) for i in range(meta.num_row_groups)]
    table.budget.check("rows", meta.num_rows)
    table.budget.spend("unpacked_bytes", sum(max(group.total_byte_size, 0) for group in groups))
    table.named(schema.names)
    wanted = {*table.wanted} - _images(file, schema, {*table.wanted})
    kept = [about.name for about in schema if about.name in wanted and _is_signal(about.type)]
    numbers = sum(is_number(schema.field(i).type) for i, n in enumerate(schema.names) if n in wanted)
    table.budget.check("numbers", max(meta.num_rows, 0) * numbers)
    rows = max(min(_ROWS, _CELLS // max(len(kept), 1)), 1)
    for batch in file.iter_batches(batch_size=rows, columns=kept, use_threads=False):
        table.add(batch.select([i for i, name in enumerate(batch.schema.names) if name in wanted]))
    return schema


def _is_signal(kind: pa.DataType) -> bool:
    return is_text(kind) or is_number(kind) or is_listed(kind)


def _images(file: Any, schema: pa.Schema, wanted: set[str]) -> set[str]:
    """Columns whose first list is longer than a signal has items: images.

    The footer counts the items, too, but pyarrow ends the process where it contradicts itself.
    """
    lists = [about.name for about in schema if about.name in wanted and is_listed(about.type)]
    first = next(file.iter_batches(batch_size=1, columns=lists, use_threads=False), None) if lists else None
    if first is None:
        return set()
    cells = zip(first.schema, first.columns, strict=True)
    return {about.name for about, c in cells if is_listed(about.type) and len(c.flatten()) > MAX_ITEMS}


def _stated_settings(metadata: Mapping[bytes, bytes], table: Columns) -> dict[str, np.ndarray]:
    """The settings of a stored recording, one column each, from its schema's metadata."""
    stated = metadata.get(b"dynreg")
    if stated is None:
        return {}
    table.budget.check("json_bytes", len(stated))
    try:
        episodes = json.loads(stated)["episodes"]
        names = sorted({name for e in episodes for name in e["settings"]})
        rows = np.array([int(e["rows"]) for e in episodes], dtype=np.int64)
        table.budget.check("columns", len(names))
        table.budget.spend("numbers", len(names) * table.rows)
        if rows.sum() != table.rows or (rows < 0).any():
            raise ValueError("its rows are not those of its episodes")
        told = {n: column(e["settings"].get(n) for e in episodes) for n in names}
        return {n: np.repeat(doubles(values), rows) for n, (values, odd) in told.items() if not odd}
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        text = f"the settings in its metadata cannot be read and are left out: {error}"
        table.findings.append(Finding("warning", "left_out", table.path.name, text))
        return {}

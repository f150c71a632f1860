"""A folder of Parquet files that Hugging Face, DuckDB and pandas read."""

import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from dynreg.datasets.export import Export

ROWS = 4_000_000  # in a file, about: some 100 MB
SCHEMA = "dynreg/dataset/1"


def write(export: Export, folder: Path, name: str) -> None:
    """`data/train-*.parquet` with the columns of `Dataset.to_arrow`, and `entries.parquet`.

    The schema's metadata tells the robot, the populations and the recordings, as JSON under `dynreg`.
    """
    (folder / "data").mkdir()
    text = json.dumps({"schema": SCHEMA, **export.about}, sort_keys=True, separators=(",", ":"))
    rows = export.dataset.to_arrow()
    schema = plain(rows.schema).with_metadata({"dynreg": text})
    for number, batches in enumerate(_files(rows)):
        with pq.ParquetWriter(
            folder / f"data/train-{number:05d}.parquet", schema, compression="zstd"
        ) as file:
            for batch in batches:
                file.write_table(pa.Table.from_batches([batch]).cast(schema))
    pq.write_table(export.table(), folder / "entries.parquet", compression="zstd")


def plain(schema: pa.Schema) -> pa.Schema:
    """A schema with text in place of dictionaries of text, which some readers do not take."""
    return pa.schema(
        [f.with_type(pa.string()) if pa.types.is_dictionary(f.type) else f for f in schema], schema.metadata
    )


def _files(rows: pa.RecordBatchReader) -> Iterator[Iterator[pa.RecordBatch]]:
    """The batches of one file after the other."""
    first = next(rows, None)

    def of_a_file() -> Iterator[pa.RecordBatch]:
        nonlocal first
        written = 0
        while first is not None and written < ROWS:
            written += len(first)
            yield first
            first = next(rows, None)

    while first is not None:
        yield of_a_file()

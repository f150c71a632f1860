"""Rows as one CSV file: those of a dataset, or a recording as a log that needs no map; entries as another."""

from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from dynreg.data.table import to_csv
from dynreg.datasets.export import Export
from dynreg.datasets.formats.parquet_files import plain


def is_file(export: Export) -> bool:
    """Always."""
    return True


def as_logs(export: Export) -> bool:
    """Where it is one recording and nothing else."""
    return export.is_log


def write(export: Export, folder: Path, name: str) -> None:
    """The columns of `Dataset.to_arrow`; a recording alone has those of its log, which `dynreg ingest` reads.

    `NAME.entries.csv` has `Export.table` where there are simulated entries.
    """
    if as_logs(export):
        (folder / name).write_bytes(to_csv(export.recordings[0].read()))
        return
    rows = export.dataset.to_arrow()
    schema = plain(rows.schema)
    with csv.CSVWriter(folder / name, schema) as file:
        for batch in rows:
            file.write_table(pa.Table.from_batches([batch]).cast(schema))
    if export.populations:
        csv.write_csv(export.table(), folder / f"{name}.entries.csv")

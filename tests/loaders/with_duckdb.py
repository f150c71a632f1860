"""DuckDB on an exported folder, on its CSV, and on a shard and a recording of a registry."""

import sys
from pathlib import Path

import duckdb
import numpy as np

folder, registry, out = map(Path, sys.argv[1:])
found = {}
for name, files in {
    "states": folder / "parquet" / "data" / "*.parquet",
    "again": folder / "csv.csv",
    "shard": registry / "shards" / "*.parquet",
    "recording": registry / "recordings" / "*.parquet",
}.items():
    table = duckdb.read_csv(str(files)) if files.suffix == ".csv" else duckdb.read_parquet(str(files))
    print(f"{name}: {table.shape}, first row {table.limit(1).fetchall()[0]}")
    columns = table.select('"arm/position", "arm/velocity"').fetchnumpy()
    found[name] = np.stack([np.asarray(column) for column in columns.values()], axis=1)
entries = str(folder / "parquet" / "entries.parquet")
many = f"'{folder / 'parquet' / 'data' / '*.parquet'}'"
joined = duckdb.sql(
    f"""select number, resistance, max(abs("arm/velocity")) as fastest
    from {many} join (select id, resistance from '{entries}') on entry = id group by all order by number"""
)
print(joined)
resistance = np.asarray(joined.fetchnumpy()["resistance"])
np.savez(out, **found | {"recording": found["recording"][:, 0], "resistance": resistance})

"""Hugging Face's datasets on an exported folder, its parameters, a shard and a recording of a registry."""

import sys
from pathlib import Path

import numpy as np
from datasets import disable_progress_bars, load_dataset

folder, registry, out = map(Path, sys.argv[1:])
disable_progress_bars()
cache = str(out.parent / "cache")


def shown(name, dataset):
    print(f"{name}: {dataset.shape}, first row {dataset[0]}")
    return dataset.with_format("numpy")


rows = shown("load_dataset(folder)", load_dataset(str(folder / "parquet"), split="train", cache_dir=cache))
by_type = load_dataset("parquet", data_dir=str(folder / "parquet"), split="train", cache_dir=cache)
shown('load_dataset("parquet", data_dir=...)', by_type)
entries = load_dataset(str(folder / "parquet"), "entries", split="train", cache_dir=cache)
shown('load_dataset(folder, "entries")', entries)
found = {}
for kind in ("shards", "recordings"):
    file = str(next((registry / kind).glob("*.parquet")))
    found[kind] = shown(kind, load_dataset("parquet", data_files=file, split="train", cache_dir=cache))
np.savez(
    out,
    states=np.stack([rows["arm/position"], rows["arm/velocity"]], axis=1),
    again=np.stack([by_type["arm/position"], by_type["arm/velocity"]], axis=1),
    shard=np.stack([found["shards"]["arm/position"], found["shards"]["arm/velocity"]], axis=1),
    recording=np.array(found["recordings"]["arm/position"]),
    resistance=np.array(entries["resistance"]),
)

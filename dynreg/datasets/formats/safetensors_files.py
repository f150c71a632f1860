"""The trained models of entries in one safetensors file, with what is needed to predict from them."""

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from dynreg.data.recording import Channel
from dynreg.datasets.export import Export
from dynreg.errors import UsageError

SCHEMA = "dynreg/models/1"
_NAMES = {"float16": "F16", "float32": "F32"}  # of a number, in the file's header


def check(export: Export) -> None:
    """UsageError for recordings without a model, and for entries of several populations, which take other rows."""
    populations = {one.population for one in (*export.populations, *export.measured)}
    bare = len(export.recordings) > len(export.measured)
    if bare or len(populations) != 1:
        raise UsageError(
            "recordings as safetensors" if bare else f"models of {len(populations)} populations",
            expected="entries of one population, simulated or measured",
            do="export each population by itself; `dynreg list --kind measured` has the entries of recordings",
        )


def write(export: Export, folder: Path, name: str) -> None:
    """`models.safetensors`: normaliser and weights stacked over the entries, as they are kept.

    Its metadata tells, as JSON under `dynreg`, the ids and numbers of the entries, the columns with their units and the
    nominal context. `entries.parquet` is `Export.models_table`: the same entries in the same order.
    """
    layers = next(_weights(export))
    count, scale = export.models, export.dataset.normaliser.as_arrays()
    shapes = {key: (str(a.dtype), a.shape) for key, a in scale.items()}
    shapes |= {key: (str(a.dtype), (count, *a.shape[1:])) for key, a in sorted(layers.items())}
    # The library's writer wants all weights in memory; this one puts each shard's in their place.
    with open(folder / "models.safetensors", "wb") as file:
        begins = _head(file, shapes, _about(export, len(layers) // 2))
        for key, array in scale.items():
            file.seek(begins[key])
            file.write(array.tobytes())
        done = 0
        for weights in _weights(export):
            for key, array in weights.items():
                file.seek(begins[key] + done * array[0].nbytes)
                file.write(np.ascontiguousarray(array).data)
            done += len(array)
    pq.write_table(export.models_table(), folder / "entries.parquet", compression="zstd")


def _weights(export: Export) -> Iterator[Mapping[str, np.ndarray]]:
    """Of all entries, some at a time."""
    for one in export.populations:
        yield from one.weights()
    for one in export.measured:
        yield {name: array[None] for name, array in one.weights.items()}


def _about(export: Export, layers: int) -> dict[str, Any]:
    told = (*export.populations, *export.measured)[0]
    entries = export.models_table()

    def named(columns: tuple[Channel, ...]) -> list[list[str]]:
        return [[c.name, c.unit] for c in columns]

    return {
        "schema": SCHEMA,
        **export.about,
        "entries": entries["id"].to_pylist(),
        "numbers": entries["number"].to_pylist(),
        "layers": layers,
        "states": named(told.columns.states),
        "actions": named(told.columns.actions),
        "context": named(told.columns.context),
        "usual": told.usual.tolist(),
    }


def _head(
    file: Any, shapes: Mapping[str, tuple[str, tuple[int, ...]]], about: Mapping[str, Any]
) -> dict[str, int]:
    """Write the header of a safetensors file; where each array begins in it."""
    header: dict[str, Any] = {
        "__metadata__": {"dynreg": json.dumps(about, sort_keys=True, separators=(",", ":"))}
    }
    at, begins = 0, {}
    # the widest numbers first, as the library does: so all are aligned
    for key in sorted(shapes, key=lambda key: (-np.dtype(shapes[key][0]).itemsize, key)):
        kind, shape = shapes[key]
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        header[key] = {"dtype": _NAMES[kind], "shape": list(shape), "data_offsets": [at, at + size]}
        begins[key] = at
        at += size
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    file.write(struct.pack("<Q", len(text)) + text)
    file.truncate(8 + len(text) + at)
    return {key: 8 + len(text) + begin for key, begin in begins.items()}

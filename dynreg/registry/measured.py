"""Real robots as entries: the models that were trained on recordings, beside those of a population's simulators."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import select

import dynreg.registry.tables as tables
from dynreg.errors import RegistryError
from dynreg.registry.codec import arrays_of, encode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.files import content_name, unreadable
from dynreg.registry.populations import get_population
from dynreg.registry.records import MeasuredEntry
from dynreg.registry.rows import require

_HEADER = ("population", "recording", "own_loss", "train_loss")


def put_measured(directory: Directory, entry: MeasuredEntry) -> str:
    """Store the model of a recording in a population, where it has none there yet; returns the id of the stored one.

    Raises NoMatchError where the population or the recording is unknown, RegistryError where its losses or weights are
    no finite numbers, or are not of the names, shapes and numbers of the population's other models.
    """
    get_population(directory, entry.population_id)
    if odd := _oddity(entry, _layout(directory, entry.population_id)):
        raise RegistryError(
            f"a model in population {entry.population_id[:12]} {odd}",
            expected="finite weights and losses, of the shapes of the population's models",
            do="train it with the population's settings",
        )
    held = measured_in(directory, entry.population_id).get(entry.recording_id)
    if held is not None:
        return held
    told = (entry.population_id, entry.recording_id, entry.own_loss, entry.train_loss)
    data = encode_arrays(dict(entry.weights), dict(zip(_HEADER, told, strict=True)))
    stem = f"{entry.population_id[:16]}-{entry.recording_id[:16]}"
    file = content_name("measured", stem, data, "safetensors")
    directory.stage(file, data)
    with directory.catalog.write() as writing:
        require(writing.connection, tables.recordings, entry.recording_id, "recording")
        table = tables.measured
        same = (table.c.population_id == entry.population_id) & (table.c.recording_id == entry.recording_id)
        held = writing.connection.execute(select(table.c.id).where(same)).scalar()
        if held is not None:
            return held
        directory.register(writing, file, data)
        row = {"id": entry.id, "population_id": entry.population_id, "recording_id": entry.recording_id}
        writing.put(table, row | {"path": file.path})
    return entry.id


def get_measured(directory: Directory, identity: str) -> MeasuredEntry:
    """The model of a recording; NoMatchError when unknown, CorruptError when its file is damaged."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.measured, identity, "measured")
    path = directory.locate(row.path)
    entry = measured_of(path, arrays_of(path, directory.read_bytes(row.path)))
    told = identity, row.population_id, row.recording_id
    if (entry.id, entry.population_id, entry.recording_id) != told:
        raise unreadable(path, "it is of another entry")
    if odd := _oddity(entry, _layout(directory, entry.population_id)):
        raise unreadable(path, f"its model {odd}")
    return entry


def measured_in(directory: Directory, population_id: str) -> dict[str, str]:
    """{id of a recording: id of its entry} of a population."""
    table = tables.measured
    query = select(table.c.recording_id, table.c.id).where(table.c.population_id == population_id)
    with directory.catalog.read() as connection:
        return dict(connection.execute(query.order_by(table.c.id)).all())


def measured_of(path: Path, told: tuple[dict[str, Any], dict[str, np.ndarray]]) -> MeasuredEntry:
    """The entry in a file (header and arrays); CorruptError where the header is none of dynreg's."""
    header, weights = told
    try:
        population, recording, own, trained = (header[key] for key in _HEADER)
        if not isinstance(population, str) or not isinstance(recording, str):
            raise ValueError("it does not say of what it is")
        if type(own) not in (int, float) or type(trained) not in (int, float):
            raise ValueError("its losses are no numbers")
        entry = MeasuredEntry(population, recording, weights, float(own), float(trained))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise unreadable(path, error) from error
    if odd := _oddity(entry, None):
        raise unreadable(path, f"its model {odd}")
    return entry


def weights_layout(entry: MeasuredEntry) -> dict[str, Any]:
    """Shape and kind of number of each of its weights, as a population's layout tells those of its entries."""
    return {name: [list(array.shape), str(array.dtype)] for name, array in entry.weights.items()}


def _layout(directory: Directory, population_id: str) -> dict[str, Any] | None:
    """The layout of a population's entries; None where it has none yet."""
    with directory.catalog.read() as connection:
        told = require(connection, tables.populations, population_id, "population").layout
    return None if told is None else json.loads(told)


def _oddity(entry: MeasuredEntry, layout: dict[str, Any] | None) -> str:
    """Why this is none of a population's models, by the layout of its entries where it is known; "" where it is one."""
    if not (math.isfinite(entry.own_loss) and math.isfinite(entry.train_loss)):
        return f"has the losses {entry.own_loss} and {entry.train_loss}"
    for name, array in entry.weights.items():
        if array.dtype.kind != "f" or not np.isfinite(array).all():
            return f"has weights {name!r} that are not finite"
    if layout is not None and layout.get("weights") != weights_layout(entry):
        return "has other weights than the models of its population"
    return ""

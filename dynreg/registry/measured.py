"""Real robots as entries: the models that were trained on recordings, beside those of a population's simulators."""

from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import select

import dynreg.registry.tables as tables
from dynreg.registry.codec import arrays_of, encode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.files import content_name, unreadable
from dynreg.registry.populations import get_population
from dynreg.registry.records import MeasuredEntry
from dynreg.registry.rows import require

_HEADER = ("population", "recording", "own_loss", "train_loss")


def put_measured(directory: Directory, entry: MeasuredEntry) -> str:
    """Store the model of a recording in a population, where it has none there yet; returns the id of the stored one.

    Raises NoMatchError where the population or the recording is unknown.
    """
    get_population(directory, entry.population_id)
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
    if entry.id != identity:
        raise unreadable(path, "it is of another entry")
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
        return MeasuredEntry(population, recording, weights, float(own), float(trained))
    except (KeyError, TypeError, ValueError) as error:
        raise unreadable(path, error) from error

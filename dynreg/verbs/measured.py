"""Real robots as entries: a recording's own model, registered beside those of simulators."""

import base64
import hashlib
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

import numpy as np

from dynreg.data.recording import Recording
from dynreg.distance.population import Population, Shared
from dynreg.distance.query import DistanceQuery, OwnModel, own_model, transitions_of
from dynreg.distance.rows import Rows, recording_rows
from dynreg.distance.table import DISTANCES
from dynreg.errors import CorruptError, Damaged, LogError
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack, stack_of
from dynreg.registry import MeasuredEntry, Registry
from dynreg.results.neighbours import MeasuredNeighbour
from dynreg.verbs.subjects import Recorded

T = TypeVar("T")
KEPT = "models"  # the folder of the cache that keeps the models of recordings


def register_measured(asked: Recorded, population: Population, *, threads: int = 0) -> str | None:
    """The id of a recording's entry in a population: its model, trained on rows from all of it, stored if it was not.

    A fifth of the rows is held out for its own loss, as of every entry; `own_model` thins the others.
    None where it has no model: its control is timed, too few of its rows were measured, its loss is no number, or it is
    not stored itself.
    """
    registry, recording, shared = asked.registry, asked.recording, population.shared
    if not registry.holds(recording.id):
        return None
    held = registry.measured_in(population.id).get(recording.id)
    if held is not None or registry.read_only or shared.robot.file.robot.control == "timed":
        return held
    rows = rows_of(shared, recording)
    try:
        model = kept_model(registry, population.id)(shared, rows, threads)
    except LogError:
        return None
    own, trained = (float(losses(model, *part)[0]) for part in (rows.held, rows.train))
    if not (math.isfinite(own) and math.isfinite(trained)):
        return None
    weights = {name: array[0] for name, array in model.as_arrays().items()}
    return registry.put_measured(MeasuredEntry(population.id, recording.id, weights, own, trained))


def kept_model(registry: Registry, population_id: str) -> OwnModel:
    """Gives the model of a recording's rows in a population: trained once, and kept for whoever asks with these rows.

    A query that holds rows out trains on the others, so that the stored entry of a recording, which had rows from
    all of it, is not asked.
    """

    def model(shared: Shared, rows: Rows, threads: int) -> MlpStack:
        digest = hashlib.sha256()
        for array in rows.train:
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array, dtype=np.float32))
        key = {"population": population_id, "rows": digest.hexdigest()}
        held = registry.cached(KEPT, key)
        if held is not None:
            return MlpStack.from_arrays({name: _array(*told) for name, told in held.items()})
        made = own_model(shared, rows, threads)
        registry.cache(KEPT, key, {name: _told(array) for name, array in made.as_arrays().items()})
        return made

    return model


def _told(array: np.ndarray) -> tuple[str, list[int]]:
    """Half-precision weights as JSON: their bytes in base64, and their shape."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f2")).decode(), list(array.shape)


def _array(told: str, shape: list[int]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(told), dtype="<f2").reshape(shape)


def near_measured(
    asked: Recorded, query: DistanceQuery, distance: str, k: int
) -> tuple[MeasuredNeighbour, ...]:
    """The k other recordings of the population that are nearest by a distance; none where it cannot tell."""
    registry, population = asked.registry, query.population
    others = {r: e for r, e in registry.measured_in(population.id).items() if r != asked.recording.id}
    sound = list(each_sound(others, lambda entry: model_of(registry, entry)))
    if not sound:
        return ()
    apart = DISTANCES[distance].to_models(query, stack_of([model for _, _, model in sound]))
    if apart is None:
        return ()
    each = zip(apart.tolist(), sound, strict=True)
    near = sorted((far, (r, e)) for far, (r, e, _) in each if math.isfinite(far))[:k]  # a model may diverge
    return tuple(
        MeasuredNeighbour(entry=entry, recording=r, name=registry.recording_info(r).name, distance=far)
        for far, (r, entry) in near
    )


def each_sound(held: Mapping[str, str], read: Callable[[str], T]) -> Iterator[tuple[str, str, T]]:
    """(recording, entry, what `read` makes of the entry) of each; a damaged one is passed over, which is said."""
    for recording, entry in held.items():
        try:
            made = read(entry)
        except CorruptError as error:
            warnings.warn(f"measured entry {entry[:12]} is passed over: {error.problem}", Damaged, 3)
        else:
            yield recording, entry, made


def rows_of(shared: Shared, recording: Recording) -> Rows:
    """All rows of a recording as the models of a population expect them."""
    return recording_rows(transitions_of(shared.robot, recording), shared.normaliser)


def model_of(registry: Registry, measured: str) -> MlpStack:
    """(1) the model of a recording's entry."""
    weights = registry.measured(measured).weights
    return MlpStack.from_arrays({name: array[None] for name, array in weights.items()})

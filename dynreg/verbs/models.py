"""The trained models of entries, and how far entries are from each other."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynreg.errors import UsageError
from dynreg.models.dynamics import DynamicsModel
from dynreg.models.mlp import MlpStack
from dynreg.registry import Registry
from dynreg.verbs.populations import load_graph, load_population, shared_of
from dynreg.verbs.simulators import told_last

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("entry", "population")


def dynamics_model(registry: Registry, refs: str | Sequence[str]) -> DynamicsModel:
    """The models of entries, in the order of `refs`, or of all entries of a population, by number.

    A single id of an entry gives one model alone. Raises NoMatchError for a ref that fits nothing, UsageError for
    entries of several populations, whose models do not take the same rows.
    """
    named = [refs] if isinstance(refs, str) else list(refs)
    found = [registry.resolve(told_last(registry, ref), KINDS) for ref in named]
    places = {i: registry.entry(i)[0] for kind, i in found if kind == "entry"}
    populations = list(dict.fromkeys(places.get(identity, identity) for _, identity in found))
    if len(populations) != 1 or len(set(found)) != len(found):
        raise UsageError(
            f"models of {len(found)} things of {len(populations)} populations",
            expected="entries of one population, each once, or one population",
            do="ask for each population by itself",
        )
    record = registry.population(populations[0])
    held = registry.load(record.id, ("weights",))
    at = {identity: i for i, identity in enumerate(held.ids)}
    rows = [i for kind, one in found for i in (range(len(held)) if kind == "population" else [at[one]])]
    shared = shared_of(registry, record)
    robot = shared.robot
    return DynamicsModel(
        entries=tuple(held.ids[i] for i in rows),
        alone=isinstance(refs, str) and found[0][0] == "entry",
        stack=MlpStack.from_arrays(held.weights)[np.array(rows)],
        normaliser=shared.normaliser,
        states=robot.channels,
        actions=robot.actions,
        context=(*robot.inputs, *robot.settings),
        usual=np.array([*robot.input_defaults, *(s.nominal for s in robot.file.settings)]),
    )


def near_entries(registry: Registry, ref: str, k: int) -> "pd.DataFrame":
    """The k entries nearest to an entry by cross-loss, found by walking the population's graph from it.

    Columns: id, number, distance. Raises UsageError where the population is not linked, NoMatchError where there is no
    such entry.
    """
    import pandas as pd

    from dynreg.index import search
    from dynreg.rng import stream

    if k < 1:
        raise UsageError(f"k = {k}", expected="at least 1", do="ask for one neighbour or more")
    identity = registry.resolve(told_last(registry, ref), ("entry",))[1]
    record = registry.population(registry.entry(identity)[0])
    graph = load_graph(registry, record.id)
    if graph is None:
        raise UsageError(
            f"population {record.id[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link",
        )
    population = load_population(registry, record.id, states=True)
    own = population.entries.ids.index(identity)
    distance, count = population.cross_loss, min(k + 1, len(population))

    def to(ids: np.ndarray) -> np.ndarray:
        return distance.pairs(np.full(len(ids), own), ids)

    found = search(graph, to, count, stream(record.seed, "neighbours"), ef=max(2 * count, 30))
    near = [(int(i), float(d)) for i, d in zip(found.ids, found.distances, strict=True) if i != own][:k]
    ids, numbers = population.entries.ids, population.entries.numbers
    return pd.DataFrame(
        {
            "id": [ids[i] for i, _ in near],
            "number": [int(numbers[i]) for i, _ in near],
            "distance": [d for _, d in near],
        }
    )


def entry_distance(registry: Registry, a: str, b: str) -> float:
    """The cross-loss distance of two entries of a population: 1 for the same, larger for others (paper D)."""
    first, second = (registry.load_entry(told_last(registry, ref)) for ref in (a, b))
    if first.population_id != second.population_id:
        raise UsageError(
            f"entries of populations {first.population_id[:12]} and {second.population_id[:12]}",
            expected="two entries of one population: distances exist only inside one",
            do="see `dynreg show ID` for an entry's population",
        )
    from dynreg.distance.population import cross_loss

    shared = shared_of(registry, registry.population(first.population_id))
    weights = {name: np.stack([first.weights[name], second.weights[name]]) for name in first.weights}
    states = np.stack([first.states, second.states])
    return float(
        cross_loss(shared, states, MlpStack.from_arrays(weights)).pairs(np.array([0]), np.array([1]))[0]
    )

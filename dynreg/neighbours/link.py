"""Link: the navigable small world over cross-losses, and the embedding, of a population's entries."""

from collections.abc import Sequence

import numpy as np

from dynreg.distance.embedding import Embedding, fit_embedding
from dynreg.index import Counted, Graph, build
from dynreg.models.mlp import MlpStack
from dynreg.neighbours.population import Population, cross_loss, shared_from
from dynreg.registry import Registry
from dynreg.sim.robot import Robot, load_robot


def link(registry: Registry, population: str, *, threads: int = 0) -> tuple[int, int]:
    """Build the graph and the embedding of all entries and keep them in the registry's index.

    Returns the number of linked entries and of distance evaluations. Both can always be rebuilt.
    """
    record = registry.population(population)
    robot = robot_of(registry, record)
    shared = shared_from(robot, record)
    entries = registry.load(population)
    stack = MlpStack.from_arrays(entries.weights)
    distance = Counted(cross_loss(shared, entries, stack, threads=threads))
    graph = build(distance, len(entries), seed=record.seed)
    registry.put_index(population, "graph", graph.to_arrays(), entries.ids)
    embedding = fit_embedding(stack, shared.base, shared.probes)
    arrays = embedding.as_arrays() | {"vectors": embedding.vectors(stack)}
    registry.put_index(population, "embedding", arrays, entries.ids)
    return len(entries), distance.evaluations


def load_population(registry: Registry, ref: str, *, states: bool = False) -> Population:
    """A population held ready for queries; its embedding is rebuilt where the index lacks it."""
    record = registry.population(ref)
    shared = shared_from(robot_of(registry, record), record)
    entries = registry.load(ref, ("states", "weights") if states else ("weights",))
    stack = MlpStack.from_arrays(entries.weights)
    arrays = registry.index(ref, "embedding", entries.ids)  # not one for entries that others added meanwhile
    if arrays is None:
        embedding = fit_embedding(stack, shared.base, shared.probes)
        vectors = embedding.vectors(stack)
    else:
        vectors = arrays["vectors"]
        embedding = Embedding(*(arrays[k] for k in ("probes", "base", "mean", "components")))
    return Population(record, shared, entries, stack, embedding, np.asarray(vectors, dtype=float))


def load_graph(registry: Registry, ref: str, entries: Sequence[str] | None = None) -> Graph | None:
    """The graph over a population's entries (those it holds now); None where it was not linked with these."""
    arrays = registry.index(ref, "graph", entries)
    return None if arrays is None else Graph.from_arrays(arrays)


def robot_of(registry: Registry, record) -> Robot:
    """The robot of a population, from the registry's own copy, with the population's ranges."""
    from dataclasses import replace

    robot = load_robot(registry.robot_folder(record.robot_hash))
    ranges = {name: (low, high) for name, (low, high, _) in record.spec["ranges"].items()}
    return replace(robot, space=robot.space.with_ranges(ranges))

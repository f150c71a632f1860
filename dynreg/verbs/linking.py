"""Linking: what a population's index keeps of its entries, for those that came since it was linked last.

Three indexes stand beside the shards: "embedding" (what a query must know of every entry), "graph", and "judged" (the
rows on which cross-losses are measured). All can be made again from the shards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.distance.cross_loss import PIVOTS, CrossLoss, Judged, crossed_losses
from dynreg.distance.embedding import Embedding, fit_embedding
from dynreg.distance.linking import link_entries, new_graph
from dynreg.distance.population import Shared, judged_entries
from dynreg.index import Graph
from dynreg.models.mlp import MlpStack
from dynreg.models.threads import single_threaded
from dynreg.neighbours.entries import Stopwatch
from dynreg.registry import MappedModels, Registry

FITTED = 500  # entries to which the embedding is fitted: the first ones, so that it stays when others come
_MAP = ("probes", "base", "mean", "components")  # arrays of the embedding itself
_OF_ENTRIES = ("vectors", "values", "train_loss", "digests")


class StoredModels:
    """The models of a population's entries, read from its shards when they are asked for."""

    def __init__(self, mapped: MappedModels):
        self.mapped = mapped

    def __len__(self) -> int:
        return len(self.mapped)

    def __getitem__(self, ids: np.ndarray) -> MlpStack:
        return MlpStack.from_arrays(self.mapped.take(np.asarray(ids)))


@dataclass(frozen=True, eq=False)
class Embedded:
    """What a query must know of every entry: embedding and vectors (M, D'), values (M, P), train_loss (M,).

    digests : (M,) of the models, by which each is compared alone when it is read.
    """

    embedding: Embedding
    vectors: np.ndarray
    values: np.ndarray
    train_loss: np.ndarray
    digests: np.ndarray

    def __len__(self) -> int:
        return len(self.vectors)

    def grown(self, new: "Embedded") -> "Embedded":
        """With the entries of another after its own, by the same embedding."""
        pairs = {name: (getattr(self, name), getattr(new, name)) for name in _OF_ENTRIES}
        return replace(self, **{name: np.concatenate(pair) for name, pair in pairs.items()})

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, for the index."""
        own = {name: array for name, array in vars(self).items() if name != "embedding"}
        return self.embedding.as_arrays() | own

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> "Embedded":
        """The inverse of `as_arrays`."""
        told = {name: arrays[name] for name in _OF_ENTRIES}
        return cls(Embedding(*(arrays[name] for name in _MAP)), **told)


@dataclass(frozen=True, eq=False)
class Linked:
    """The indexes of the first entries of a population, all of the same ones."""

    embedded: Embedded
    judged: Judged
    graph: Graph


def link(
    registry: Registry,
    ref: str,
    shared: Shared,
    *,
    threads: int = 0,
    anew: bool = False,
    watch: Stopwatch | None = None,
) -> tuple[int, int]:
    """Link the entries that are not in the index yet, or all of them `anew`; keep it, where nobody has added others.

    Returns the number of linked entries and of distances evaluated for them; `watch` takes the time of these, "graph".
    The index is the same bytes whether the population came at once or grew, on any number of threads.
    """
    from threadpoolctl import threadpool_limits

    numbers = registry.numbers(ref)
    ids = tuple(numbers)
    held = None if anew else _linked(registry, ref, ids)
    if held is not None and len(held.embedded) < max(FITTED, PIVOTS):
        held = None  # the embedding is fitted to more of them, or more of them are pivots
    known = None if held is None else held.embedded.digests
    stack = StoredModels(registry.models(ref, numbers.values(), known))
    before = new_graph(shared.seed) if held is None else held.graph
    # the same bytes on any number of threads; what is worth more cores asks for them itself
    with single_threaded(), threadpool_limits(1):
        embedded = embed(registry, ref, ids, shared, stack, None if held is None else held.embedded)
        judged = judge(registry, ref, ids, shared, stack, None if held is None else held.judged)
        distance = CrossLoss(stack, judged.inputs, judged.targets, judged.own, threads=1)
        with (watch or Stopwatch()).of("graph"):
            graph = link_entries(before, embedded.vectors, distance, threads)
    registry.put_index(ref, "embedding", embedded.as_arrays(), ids)
    registry.put_index(ref, "judged", judged.as_arrays(), ids)
    registry.put_index(ref, "graph", graph.to_arrays(), ids)  # the last: where it is, the others are
    return len(ids), graph.evaluations - before.evaluations


INDEXES = ("embedding", "judged", "graph")


def linked_of(registry: Registry, ref: str) -> int:
    """How many of a population's present entries are in its index, as this version makes it; 0 where none serves."""
    held = _linked(registry, ref, tuple(registry.numbers(ref)))
    return 0 if held is None else len(held.embedded)


def _linked(registry: Registry, ref: str, ids: Sequence[str]) -> Linked | None:
    """What is kept for the first of these entries, by this version; None where nothing is, or parts of it are lost."""
    found = [registry.grown_index(ref, key, ids) for key in INDEXES]
    if None in found or len({count for count, _ in found}) != 1:
        return None
    embedded, judged, graph = (arrays for _, arrays in found)
    known, grown = "digests" in embedded and "crossed" in judged, Graph.from_arrays(graph)
    if not known or grown.settings != new_graph(grown.settings.seed).settings:
        return None  # by an older version
    return Linked(Embedded.from_arrays(embedded), Judged(**judged), grown)


def embed(
    registry: Registry,
    ref: str,
    ids: Sequence[str],
    shared: Shared,
    stack: StoredModels,
    held: Embedded | None = None,
) -> Embedded:
    """The embedding of the entries `ids`; what is `held` of the first ones stays."""
    first = 0 if held is None else len(held)
    if first == len(ids):
        return held
    if held is None:
        some = stack[np.arange(min(FITTED, len(stack)))]
        embedding = fit_embedding(some, shared.base, shared.probes)
    else:
        embedding = held.embedding
    told = registry.load(ref, (), since=int(stack.mapped.numbers[first]))
    place = {identity: row for row, identity in enumerate(told.ids)}  # others may have come meanwhile
    rows = np.array([place[identity] for identity in ids[first:]])
    vectors, digests = [], []
    for part in _parts(first, len(stack)):
        vectors.append(embedding.vectors(stack[part]))
        digests.append(stack.mapped.digests_of(part))
    new = Embedded(
        embedding,
        np.concatenate(vectors),
        told.values[rows],
        told.train_loss[rows],
        np.concatenate(digests),
    )
    return new if held is None else held.grown(new)


def judge(
    registry: Registry,
    ref: str,
    ids: Sequence[str],
    shared: Shared,
    stack: StoredModels,
    held: Judged | None = None,
) -> Judged:
    """The rows on which the entries `ids` are judged; what is `held` of the first ones stays."""
    found = [] if held is None else [held]
    first = 0 if held is None else len(held)
    new, pivots = ids[first:], pivots_of(stack)
    for part in registry.parts(ref, new) if new else ():
        rows = np.arange(first, first + len(part.entries))
        (run,) = part.read()
        found.append(judged_entries(shared, run.states, stack[rows], pivots))
        first += len(rows)
    columns = zip(*(vars(one).values() for one in found), strict=True)
    return Judged(*(np.concatenate(column) for column in columns))


def judged_from(arrays: dict[str, np.ndarray], stack: StoredModels) -> Judged:
    """The inverse of `Judged.as_arrays`; what an older version did not keep is measured."""
    if "crossed" not in arrays:
        arrays = arrays | {"crossed": crossed_losses(pivots_of(stack), arrays["inputs"], arrays["targets"])}
    return Judged(**arrays)


def pivots_of(stack: StoredModels) -> MlpStack:
    """The models that are judged on the rows of all entries."""
    return stack[np.arange(min(PIVOTS, len(stack)))]


def _parts(first: int, stop: int, size: int = 50) -> list[np.ndarray]:
    return [np.arange(at, min(at + size, stop)) for at in range(first, stop, size)]

"""The navigable small world: a flat graph whose nodes link to some of their nearest, with bounded degree."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import inf

import numpy as np

from dynreg.arrays import Ids
from dynreg.errors import CorruptError, UsageError

Links = list[dict[int, float]]
"""A graph while it grows: for each node, the nodes it links to and how long each link is."""

NO_CAP = -1


@dataclass(frozen=True)
class GraphSettings:
    """How a graph grows; kept with it, so that a later extension goes on in the same way.

    Attributes
    ----------
    seed : of the nodes that each insertion starts its search from.
    f : links that a new node makes, both ways, to the nearest found.
    ef : how many of the best nodes an insertion's search keeps.
    degree_cap : the most links a node may have, or `NO_CAP`.
    batch : nodes of one generation, [0, batch), [batch, 2 batch) ...: all search the graph as it was
        before their generation, in lockstep, and consider those of their generation with a smaller id.
    starts : random nodes that each search starts from.
    printed : search by paper D's Algorithm 1 as printed instead of best first (then ef has no effect and
        starts is its number of restarts).
    """

    seed: int = 0
    f: int = 10
    ef: int = 30
    degree_cap: int = 20
    batch: int = 32
    starts: int = 8
    printed: bool = False

    def __post_init__(self):
        if min(self.f, self.ef, self.batch, self.starts) < 1 or self.seed < 0:
            raise UsageError(
                f"graph settings {self}",
                expected="seed >= 0 and f, ef, batch and starts of at least 1",
                do="raise the value that is too small",
            )
        if self.degree_cap != NO_CAP and self.degree_cap <= self.f:
            raise UsageError(
                f"a degree cap of {self.degree_cap} with f = {self.f} links for each new node",
                expected="degree_cap > f, or NO_CAP",
                do="raise degree_cap (twice f serves well) or lower f",
            )


@dataclass(frozen=True)
class Graph:
    """Nodes 0 .. len-1 and their links. Every node can be reached from every other one.

    Links are made both ways, but a full node drops its own side alone, so they are not all mutual.

    Attributes
    ----------
    settings : how the graph grew.
    neighbours : for each node, the ids that it links to, nearest first.
    lengths : for each node, the distances to them; inf for the rare link that was never measured.
    before : the neighbours as they were before the last, unfinished generation; all of them where the
        last generation is whole. What the next nodes of that generation search.
    evaluations : distances that building took.
    """

    settings: GraphSettings
    neighbours: tuple[np.ndarray, ...] = ()
    lengths: tuple[np.ndarray, ...] = ()
    before: tuple[np.ndarray, ...] = ()
    evaluations: int = 0

    def __len__(self) -> int:
        return len(self.neighbours)

    @property
    def degree(self) -> Ids:
        """(n,) how many links each node has."""
        return np.array([len(ids) for ids in self.neighbours], dtype=np.int64)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Plain integer and float arrays, for safetensors or npz; `from_arrays` undoes it."""
        settings = [int(getattr(self.settings, field.name)) for field in fields(GraphSettings)]
        return {
            "settings": np.array([*settings, self.evaluations], dtype=np.int64),
            "degree": self.degree,
            "neighbours": _joined(self.neighbours, np.int64),
            "lengths": _joined(self.lengths, np.float64),
            "before_degree": np.array([len(ids) for ids in self.before], dtype=np.int64),
            "before": _joined(self.before, np.int64),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "Graph":
        """The graph that `to_arrays` described.

        Raises
        ------
        CorruptError : arrays are missing or contradict each other.
        """
        try:
            *values, evaluations = (int(value) for value in arrays["settings"])
            named = zip(fields(GraphSettings), values, strict=True)
            graph = cls(
                settings=GraphSettings(**{field.name: field.type(value) for field, value in named}),
                neighbours=_split(arrays["neighbours"], arrays["degree"], len(arrays["degree"])),
                lengths=_split(arrays["lengths"], arrays["degree"]),
                before=_split(arrays["before"], arrays["before_degree"], len(arrays["before_degree"])),
                evaluations=evaluations,
            )
            whole = len(graph) - len(graph) % graph.settings.batch
            if len(graph.before) != whole:
                raise ValueError(f"{len(graph.before)} settled nodes instead of {whole}")
        except (KeyError, ValueError, TypeError, IndexError, UsageError) as error:
            raise CorruptError(
                f"the stored graph cannot be read ({error})",
                expected="the arrays that Graph.to_arrays wrote",
                do="build the index again; it is a cache",
            ) from error
        return graph


def link(links: Links, ids: Sequence[int], distances: Sequence[float], settings: GraphSettings) -> set[int]:
    """Append a node linked both ways to `ids`; returns the nodes whose links changed."""
    node = len(links)
    links.append(dict(zip(ids, distances, strict=True)))
    for neighbour, distance in links[node].items():
        links[neighbour][node] = distance
    if settings.degree_cap != NO_CAP:
        for neighbour in ids:
            if len(links[neighbour]) > settings.degree_cap:
                _drop_one(links, neighbour, node)
    return {node, *ids}


def _drop_one(links: Links, full: int, new: int) -> None:
    """Take one link from a node that has one too many, such that all nodes stay reachable.

    First choice is the longest link full -> v for which a known node w makes a detour full -> w -> v of two
    shorter links (the rule of the relative neighbourhood graph, on measured lengths alone); then the longest
    with any detour. A link with a detour can go without cutting anything off. Where there is none, the new
    node's link goes, for it has others; and if it has none, the new node takes over one of full's links.
    """
    mine = links[full]
    longest = sorted(mine, key=lambda v: (-mine[v], v))
    for v in longest:
        if any(reach < mine[v] and links[w].get(v, inf) < mine[v] for w, reach in mine.items()):
            del mine[v]
            return
    for v in longest:
        if any(v in links[w] for w in mine):
            del mine[v]
            return
    if sum(new in links[neighbour] for neighbour in links[new]) > 1:
        del mine[new]
        return
    taken = next(v for v in longest if v != new)
    links[new].setdefault(taken, inf)
    del mine[taken]


def thaw(graph: Graph) -> Links:
    """The links of a graph, to change."""
    return [
        dict(zip(ids.tolist(), lengths.tolist(), strict=True))
        for ids, lengths in zip(graph.neighbours, graph.lengths, strict=True)
    ]


def freeze(graph: Graph, links: Links, changed: Iterable[int], evaluations: int) -> Graph:
    """The graph of `links`, of which those of `changed` differ from `graph`'s."""
    neighbours = [*graph.neighbours, *[None] * (len(links) - len(graph))]
    lengths = [*graph.lengths, *[None] * (len(links) - len(graph))]
    for node in changed:
        ordered = sorted(links[node].items(), key=lambda item: (item[1], item[0]))
        neighbours[node] = np.array([v for v, _ in ordered], dtype=np.int64)
        lengths[node] = np.array([length for _, length in ordered], dtype=np.float64)
        neighbours[node].setflags(write=False)
        lengths[node].setflags(write=False)
    whole = len(links) % graph.settings.batch == 0
    before = tuple(neighbours) if whole else graph.before
    return Graph(graph.settings, tuple(neighbours), tuple(lengths), before, evaluations)


def _joined(parts: Sequence[np.ndarray], dtype: type) -> np.ndarray:
    return np.concatenate([np.zeros(0, dtype), *parts]).astype(dtype)


def _split(values: np.ndarray, counts: np.ndarray, below: int | None = None) -> tuple[np.ndarray, ...]:
    """`values` cut into runs of `counts`; ids are checked to be under `below`."""
    if counts.ndim != 1 or values.ndim != 1 or counts.min(initial=0) < 0 or counts.sum() != len(values):
        raise ValueError(f"{len(values)} links where {counts.sum()} are announced")
    if below is not None and len(values) and not 0 <= values.min() <= values.max() < below:
        raise ValueError(f"a link to node {values.max()} of {below}")
    parts = tuple(np.split(values, np.cumsum(counts)[:-1])) if len(counts) else ()
    for part in parts:
        part.setflags(write=False)
    return parts

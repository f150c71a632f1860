"""How good an index is: recall and cost against brute force, growth with n, hubness."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from index_entries import MatrixDistance
from landmarks import Landmarks, build_landmarks, search_landmarks

from dynreg.arrays import Distances, Ids
from dynreg.errors import UsageError
from dynreg.index import (
    NO_CAP,
    Distance,
    Found,
    Graph,
    GraphSettings,
    ToMany,
    build,
    search_many,
    search_printed,
)
from dynreg.rng import stream

Measured = tuple[list[Found], float]
"""What a method found for each query, and how many evaluations a node cost to insert."""

Method = Callable[[Distance, ToMany, int, int, int, int], Measured]
"""From (nodes, to, queries, n, k, seed): index the first n nodes and search it for every query."""


@dataclass(frozen=True)
class Row:
    """One method at one size, averaged over queries.

    Attributes
    ----------
    method : its name in the table of methods.
    n : nodes in the index.
    recall : share of the k returned that are as near as the k-th nearest (ties count).
    quality : share that the search has of what brute force gains over nodes at random; see `quality`.
    evaluations : distances that one query asks for.
    insertion : distances that building took, for each node.
    """

    method: str
    n: int
    recall: float
    quality: float
    evaluations: float
    insertion: float


@dataclass(frozen=True)
class Growth:
    """Least-squares fits of cost = a + b log n and of cost = a + b n, with their share of the variance
    explained and root mean squared residual, in evaluations."""

    log_slope: float
    log_r2: float
    log_residual: float
    linear_slope: float
    linear_r2: float
    linear_residual: float


@dataclass(frozen=True)
class Hubness:
    """How unevenly nodes occur among the neighbours of others: skewness of the occurrences (0 for an even
    spread), the occurrences of the most frequent node, and the share of nodes that never occur."""

    skewness: float
    largest: int
    never: float


def recall(found: Sequence[Found], truth: np.ndarray, k: int) -> float:
    """Mean share of the k nearest that were found, by distance threshold: `truth` (Q, n) are all distances
    of each query, and whatever is as near as its k-th counts, ties included."""
    k = min(k, truth.shape[1])
    worst = np.partition(truth, k - 1, axis=1)[:, k - 1]
    near = [np.sum(one.distances[:k] <= d + 1e-12 * abs(d)) / k for one, d in zip(found, worst, strict=True)]
    return float(np.mean(near))


def quality(found: Sequence[Found], truth: np.ndarray, k: int) -> float:
    """Share that a search has of what brute force gains over nodes at random: in mean log d of k, over all queries.

    1 is as good as brute force, 0 is chance. Paper D says "about 90 % as good", and not of what. The excess d - 1 is no
    measure here: noise in the losses puts many of the nearest below 1.
    """
    every = np.log(truth).mean()
    best = np.log(np.sort(truth, axis=1)[:, :k]).mean()
    got = np.mean([np.log(one.distances[:k]).mean() for one in found])
    return float((every - got) / (every - best))


def hubness(neighbours: Sequence[np.ndarray], n: int) -> Hubness:
    """Of lists of neighbours, such as the k nearest of every node, or a graph's `neighbours`."""
    counts = np.bincount(np.concatenate([np.zeros(0, np.int64), *neighbours]), minlength=n)
    centred = counts - counts.mean()
    spread = max(float(np.mean(centred**2)), 1e-12)
    skewness = float(np.mean(centred**3)) / spread**1.5
    return Hubness(skewness, int(counts.max(initial=0)), float(np.mean(counts == 0)))


def nearest_lists(distance: Distance, n: int, k: int) -> list[np.ndarray]:
    """The k nearest others of every node by brute force, n^2 evaluations in n calls."""
    lists = []
    for node in range(n):
        others = np.delete(np.arange(n), node)
        distances = distance.pairs(np.full(len(others), node), others)
        lists.append(others[np.lexsort((others, distances))[:k]])
    return lists


def fit_growth(n: Sequence[float | int] | np.ndarray, cost: Sequence[float | int] | np.ndarray) -> Growth:
    """Does the cost grow like log n or like n?

    Raises
    ------
    UsageError : fewer than three sizes, through which both lines would pass.
    """
    if len(n) < 3 or len(n) != len(cost):
        raise UsageError(
            f"{len(cost)} costs at {len(n)} sizes",
            expected="one cost at each of at least 3 sizes",
            do="measure at more sizes",
        )
    sizes, costs = np.asarray(n, dtype=np.float64), np.asarray(cost, dtype=np.float64)
    return Growth(*_line(np.log(sizes), costs), *_line(sizes, costs))


def measure_graph(
    distance: Distance | np.ndarray,
    query_to: ToMany | np.ndarray,
    queries: int | None = None,
    *,
    sizes: Sequence[int],
    k: int = 5,
    seed: int = 0,
    methods: Mapping[str, Method] | None = None,
) -> list[Row]:
    """Every method at every size, over the first n nodes each time.

    Parameters
    ----------
    distance : between nodes: a `Distance` or the full (n, n) matrix.
    query_to : from queries to nodes: `to(rows, ids)` for `queries` rows, or the full (Q, n) matrix.
    methods : by name; `METHODS` unless given, other settings by functools.partial.
    """
    nodes = MatrixDistance(distance) if isinstance(distance, np.ndarray) else distance
    if isinstance(query_to, np.ndarray):
        table = query_to
    else:
        ids = np.arange(max(sizes))
        table = np.array([query_to(np.full(len(ids), row), ids) for row in range(queries or 0)])
    rows = []
    for n in sizes:
        truth = table[:, :n]
        to = MatrixDistance(truth).pairs
        for name, method in (methods or METHODS).items():
            found, insertion = method(nodes, to, len(truth), n, k, seed)
            cost = float(np.mean([one.evaluations for one in found]))
            rows.append(Row(name, n, recall(found, truth, k), quality(found, truth, k), cost, insertion))
    return rows


def build_as_printed(distance: Distance, n: int, *, seed: int = 0, k: int = 5, restarts: int = 4) -> Graph:
    """The graph of paper D: one node at a time, k links to what Algorithm 1 finds, no cap on degree."""
    settings = GraphSettings(seed, f=k, degree_cap=NO_CAP, batch=1, starts=restarts, printed=True)
    return build(distance, n, settings)


def by_printed(
    nodes: Distance, to: ToMany, queries: int, n: int, k: int, seed: int, *, restarts: int = 4
) -> Measured:
    """Paper D's Algorithm 1 on a graph without a cap on degree."""
    graph = build_as_printed(nodes, n, seed=seed, k=k, restarts=restarts)
    found = []
    for row in range(queries):
        one = partial(_to_row, to, row)
        found.append(search_printed(graph, one, k, stream(seed, "search", row), restarts))
    return found, graph.evaluations / n


def by_graph(
    nodes: Distance,
    to: ToMany,
    queries: int,
    n: int,
    k: int,
    seed: int,
    *,
    f: int = 10,
    ef: int = 30,
    degree_cap: int = 20,
) -> Measured:
    """Best-first search on a graph with a cap on degree."""
    graph = build(nodes, n, GraphSettings(seed, f, ef, degree_cap))
    return search_many(graph, to, queries, k, seed=seed, ef=ef), graph.evaluations / n


def by_landmarks(
    nodes: Distance,
    to: ToMany,
    queries: int,
    n: int,
    k: int,
    seed: int,
    *,
    m: int = 128,
    rerank: int = 50,
    ridge: bool = True,
) -> Measured:
    """Landmarks, candidates ranked by ridge regressions or by plain distance between descriptions."""
    landmarks = build_landmarks(nodes, n, seed=seed, m=m)
    score = Landmarks.predict if ridge else Landmarks.apart
    return search_landmarks(landmarks, to, queries, k, rerank=rerank, score=score), float(len(landmarks.ids))


def by_chance(nodes: Distance, to: ToMany, queries: int, n: int, k: int, seed: int) -> Measured:
    """k random nodes: what any method has to beat."""
    found = []
    for row in range(queries):
        ids = stream(seed, "chance", row).choice(n, size=min(k, n), replace=False)
        distances = to(np.full(len(ids), row), ids)
        order = np.lexsort((ids, distances))
        found.append(Found(ids[order], distances[order], len(ids)))
    return found, 0.0


METHODS: Mapping[str, Method] = {
    "printed": by_printed,
    "graph": by_graph,
    "landmarks": by_landmarks,
    "fingerprints": partial(by_landmarks, ridge=False),
    "chance": by_chance,
}
"""The methods that `measure_graph` compares."""


def _to_row(to: ToMany, row: int, ids: Ids) -> Distances:
    return to(np.full(len(ids), row), ids)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, share of the variance explained and root mean squared residual of y = a + b x."""
    slope, constant = np.polyfit(x, y, 1)
    residual = y - constant - slope * x
    explained = 1.0 - residual @ residual / max(float(np.sum((y - y.mean()) ** 2)), 1e-12)
    return float(slope), float(explained), float(np.sqrt(np.mean(residual**2)))


COLUMNS = ("recall", "quality", "evaluations", "insertion")


def averaged(runs: Sequence[Sequence[Row]]) -> list[Row]:
    """The mean of the same rows over several seeds."""
    means = []
    for same in zip(*runs, strict=True):
        values = {name: float(np.mean([getattr(row, name) for row in same])) for name in COLUMNS}
        means.append(Row(same[0].method, same[0].n, **values))
    return means


def growths(rows: Sequence[Row]) -> Iterable[tuple[str, object]]:
    """How each method's evaluations for a query, and for an insertion, grow with n."""
    for name in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == name]
        if np.ptp([row.evaluations for row in mine]) > 1.0:
            yield f"{name}: query", fit_growth([row.n for row in mine], [row.evaluations for row in mine])
            yield f"{name}: insertion", fit_growth([row.n for row in mine], [row.insertion for row in mine])


def hubs(matrix: np.ndarray, k: int) -> dict[str, dict[str, float]]:
    """Of the true neighbours, and of the links of graphs with and without a cap on degree."""
    distance, n = MatrixDistance(matrix), len(matrix)
    capped, free = (build(distance, n, GraphSettings(degree_cap=cap)).neighbours for cap in (20, NO_CAP))
    lists = {f"{k} nearest": nearest_lists(distance, n, k), "links, cap 20": capped, "links, no cap": free}
    return {name: asdict(hubness(neighbours, n)) for name, neighbours in lists.items()}

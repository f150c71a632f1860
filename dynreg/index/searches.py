"""Walks over a graph towards a query, one at a time or many in lockstep.

A walk is a generator: it yields the ids whose distances it wants and is sent those distances. So each
algorithm is written once, and many walks advance together with one batched distance call a step.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush, heapreplace, nsmallest

import numpy as np

from dynreg.arrays import Ids
from dynreg.errors import UsageError
from dynreg.index.distance import To, ToMany
from dynreg.index.graph import Graph
from dynreg.rng import stream

STARTS = 8  # random nodes that a search starts from, all measured at once
EF = 30  # of the best nodes found, usually, are kept and expanded
Walk = Generator[list[int], list[float], list[tuple[float, int]]]


@dataclass(frozen=True)
class Found:
    """What one search returns, nearest first, equal distances by id.

    Attributes
    ----------
    ids, distances : (k,) the nearest nodes; fewer where the graph has fewer.
    evaluations : distances of the query to a node that were asked for; each node once.
    """

    ids: np.ndarray
    distances: np.ndarray
    evaluations: int


def search(graph: Graph, to: To, k: int, rng: np.random.Generator, *, ef: int = EF) -> Found:
    """The k nodes nearest to a query, by best-first search on the flat graph.

    Parameters
    ----------
    to : distances of the query to ids, in one batched call.
    rng : draws the nodes to start from.
    ef : how many of the best nodes are kept and expanded; at least k is used. With ef = len(graph) the
        search looks at every node.
    """
    walk = best_first(graph.neighbours, draw_starts(len(graph), STARTS, rng), max(ef, k))
    return lockstep([walk], lambda rows, ids: to(ids), k)[0]


def search_many(graph: Graph, to: ToMany, queries: int, k: int, *, seed: int, ef: int = EF) -> list[Found]:
    """`search` for `queries` queries that advance in lockstep; `to(rows, ids)` serves them all at once.

    Row i draws from the stream (seed, "search", i), whatever other rows there are.
    """
    starts = [draw_starts(len(graph), STARTS, stream(seed, "search", row)) for row in range(queries)]
    return lockstep([best_first(graph.neighbours, some, max(ef, k)) for some in starts], to, k)


def search_printed(graph: Graph, to: To, k: int, rng: np.random.Generator, restarts: int = 4) -> Found:
    """Paper D's Algorithm 1 with its gaps mended: greedy walks from `restarts` random nodes that keep the
    k best of all the neighbours they saw. Its cost follows the degree of the nodes it passes."""
    walk = printed(graph.neighbours, draw_starts(len(graph), restarts, rng, repeat=True), k)
    return lockstep([walk], lambda rows, ids: to(ids), k)[0]


def brute_force(to: To, n: int, k: int) -> Found:
    """The k nearest of n nodes by measuring all: the oracle, and the cost to beat."""
    distances = np.asarray(to(np.arange(n)), dtype=np.float64)
    ids = np.lexsort((np.arange(n), distances))[:k]
    return Found(ids, distances[ids], n)


def best_first(neighbours: Sequence[np.ndarray], starts: Sequence[int], ef: int) -> Walk:
    """Expand the nearest node not yet expanded until none is nearer than the ef best found."""
    seen = set(starts)
    asked = list(starts)
    open_nodes: list[tuple[float, int]] = []
    best: list[tuple[float, int]] = []  # a heap with the worst of the ef best at its head, negated
    while asked:
        for distance, node in zip((yield asked), asked, strict=True):
            if len(best) < ef:
                heappush(best, (-distance, -node))
            elif -distance > best[0][0]:
                heapreplace(best, (-distance, -node))
            else:
                continue
            heappush(open_nodes, (distance, node))
        asked = []
        while open_nodes and not asked:
            distance, node = heappop(open_nodes)
            if len(best) == ef and distance > -best[0][0]:
                break
            for neighbour in neighbours[node].tolist():
                if neighbour not in seen:
                    seen.add(neighbour)
                    asked.append(neighbour)
    return [(-distance, -node) for distance, node in best]


def printed(neighbours: Sequence[np.ndarray], starts: Sequence[int], k: int) -> Walk:
    """Algorithm 1: step to the nearest neighbour while that is nearer than where we stand."""
    known: dict[int, float] = {}
    best: set[int] = set()
    for node in starts:
        visited: set[int] = set()
        while node not in visited:
            visited.add(node)
            around = neighbours[node].tolist()
            asked = [i for i in (node, *around) if i not in known]
            if asked:
                known.update(zip(asked, (yield asked), strict=True))
            nearest = nsmallest(k, around, key=lambda i: (known[i], i))
            best = set(nsmallest(k, best | {node, *nearest}, key=lambda i: (known[i], i)))
            if nearest and known[nearest[0]] < known[node]:
                node = nearest[0]
    return [(known[i], i) for i in best]


def lockstep(walks: Sequence[Walk], to: ToMany, k: int) -> list[Found]:
    """Advance all walks together: what they ask in one step is one call of `to(rows, ids)`."""
    asked = {row: next(walk) for row, walk in enumerate(walks)}
    found: list[Found | None] = [None] * len(walks)
    evaluations = [0] * len(walks)
    while asked:
        rows = np.repeat(list(asked), [len(ids) for ids in asked.values()])
        distances = _measure(to, rows, np.array([i for ids in asked.values() for i in ids], dtype=np.int64))
        at = 0
        for row, ids in list(asked.items()):
            evaluations[row] += len(ids)
            try:
                asked[row] = walks[row].send(distances[at : at + len(ids)])
            except StopIteration as stop:
                best = sorted(stop.value)[:k]
                nearest = np.array([node for _, node in best], dtype=np.int64)
                apart = np.array([distance for distance, _ in best], dtype=np.float64)
                found[row] = Found(nearest, apart, evaluations[row])
                del asked[row]
            at += len(ids)
    return found


def _measure(to: ToMany, rows: Ids, ids: Ids) -> list[float]:
    distances = np.asarray(to(rows, ids), dtype=np.float64)
    if np.isnan(distances).any():
        raise UsageError(
            f"the distance to node {ids[np.argmax(np.isnan(distances))]} is NaN",
            expected="a number for every pair",
            do="leave out the entries whose model diverged",
        )
    return distances.tolist()


def draw_starts(n: int, count: int, rng: np.random.Generator, repeat: bool = False) -> list[int]:
    """`count` random nodes; different ones unless `repeat`."""
    if n == 0:
        raise UsageError(
            "a search in an empty graph", expected="at least one node", do="build the graph first"
        )
    if repeat:
        return rng.integers(n, size=count).tolist()
    return rng.choice(n, size=min(count, n), replace=False, shuffle=False).tolist()

"""Links between entries: candidates by their embedding, chosen by the paper's cross-loss (D).

The paper's insertion (Algorithm 1) walks the graph by cross-loss, 50 to 120 evaluations for each new entry. The
embedding knows nearly as well who is near, at a thousandth of the price, so that few candidates have to be measured.
"""

from collections.abc import Iterator

import numpy as np

from dynreg.distance.cross_loss import CrossLoss
from dynreg.index import Graph, GraphSettings, insert
from dynreg.models.threads import in_threads

CANDIDATES = 24  # for each entry; its 10 nearest by cross-loss are among them by 0.89
BLOCK = 256  # entries whose candidates are sought together


def new_graph(seed: int) -> Graph:
    """The empty graph into which entries are linked as they come."""
    return Graph(GraphSettings(seed=seed, ef=CANDIDATES, batch=1))


def link_entries(graph: Graph, vectors: np.ndarray, distance: CrossLoss, threads: int = 0) -> Graph:
    """The graph grown to all entries, whose embeddings are `vectors` (M, D').

    Who an entry is linked to depends on the entries before it and on nothing else: the same graph comes of one call and
    of many, on any number of threads.
    """
    new = list(candidates(vectors, len(graph)))
    first = len(graph)

    def measured(at: int) -> np.ndarray:
        return distance.pairs(np.full(len(new[at]), first + at), new[at])

    apart = in_threads(measured, range(len(new)), threads or None)
    return insert(graph, zip(new, apart, strict=True))


def candidates(vectors: np.ndarray, first: int = 0, count: int = CANDIDATES) -> Iterator[np.ndarray]:
    """For each entry from `first` on, the entries before it whose vectors (M, D') are nearest, at most `count`.

    By brute force: a matrix product of 64 columns, 0.1 ms an entry at ten thousand of them.
    """
    squares = np.einsum("ij,ij->i", vectors, vectors)
    for begin in range(first, len(vectors), BLOCK):
        stop = min(begin + BLOCK, len(vectors))
        apart = squares[:stop] - 2.0 * vectors[begin:stop] @ vectors[:stop].T
        for row, entry in zip(apart, range(begin, stop), strict=True):
            most = min(count, entry)
            near = np.argpartition(row[:entry], most - 1)[:most] if most else np.zeros(0, np.int64)
            yield np.sort(near)

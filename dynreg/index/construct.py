"""Growing a graph: generation by generation by walks over it, or by nodes whose nearest are known already."""

from collections.abc import Iterable

import numpy as np

from dynreg.arrays import Distances, Ids
from dynreg.errors import UsageError
from dynreg.index.distance import Distance
from dynreg.index.graph import Graph, GraphSettings, Links, freeze, link, thaw
from dynreg.index.searches import Found, best_first, draw_starts, lockstep, printed
from dynreg.rng import stream

STANDARD = GraphSettings()


def build(distance: Distance, n: int, settings: GraphSettings = STANDARD) -> Graph:
    """A graph over nodes 0 .. n-1, inserted in order of id.

    The same settings and distances give the same graph, and the graph of the first n nodes grows by `extend`
    into the very graph that building all of them at once gives.

    Raises
    ------
    UsageError : more nodes than the distance has, a distance that is NaN.
    """
    return extend(Graph(settings), distance, n)


def extend(graph: Graph, distance: Distance, n: int) -> Graph:
    """The graph grown to n nodes.

    Raises
    ------
    UsageError : n below the graph's size or above the distance's, a distance that is NaN.
    """
    if not len(graph) <= n <= len(distance):
        raise UsageError(
            f"a graph of {len(graph)} nodes to grow to {n}",
            expected=f"{len(graph)} to {len(distance)} nodes, as many as have distances",
            do="register the entries first, or build a new graph to leave some out",
        )
    links = thaw(graph)
    while len(graph) < n:
        graph = _add_generation(graph, links, distance, n)
    return graph


def insert(graph: Graph, near: Iterable[tuple[Ids, Distances]]) -> Graph:
    """The graph grown by one node after the other, linked to the `f` nearest of some that were measured.

    near : for each new node, older nodes (m,) and how far they are (m,): all of them, or candidates that something
        cheaper than the distance proposes. The graph's generations are of one node, for no node waits for another.

    Raises
    ------
    UsageError : generations of more than one node; a distance that is NaN; a node without candidates in a graph.
    """
    settings = graph.settings
    if settings.batch != 1:
        raise UsageError(
            f"a graph of generations of {settings.batch} nodes to insert into",
            expected="batch = 1",
            do="extend it by walks, or build a new one",
        )
    links, changed, asked = thaw(graph), set(), 0
    for ids, distances in near:
        ids, distances = np.asarray(ids, dtype=np.int64), np.asarray(distances, dtype=np.float64)
        if np.isnan(distances).any() or (len(links) and not len(ids)):
            raise UsageError(
                f"{len(ids)} candidates of node {len(links)}, {np.isnan(distances).sum()} at a distance of NaN",
                expected="at least one, and a number for each",
                do="leave out the entries whose model diverged",
            )
        nearest = np.lexsort((ids, distances))[: settings.f]
        changed |= link(links, ids[nearest].tolist(), distances[nearest].tolist(), settings)
        asked += len(ids)
    return freeze(graph, links, changed, graph.evaluations + asked)


def _add_generation(graph: Graph, links: Links, distance: Distance, n: int) -> Graph:
    """Insert the nodes up to the end of the current generation, or up to n."""
    settings = graph.settings
    first = len(graph.before)
    nodes = np.arange(len(graph), min(n, first + settings.batch))
    found = _search_before(graph, nodes, distance)
    mates = _measure_mates(first, nodes, distance)
    changed: set[int] = set()
    for seen, (mate_ids, mate_distances) in zip(found, mates, strict=True):
        ids = np.concatenate([seen.ids, mate_ids])
        distances = np.concatenate([seen.distances, mate_distances])
        nearest = np.lexsort((ids, distances))[: settings.f]
        changed |= link(links, ids[nearest].tolist(), distances[nearest].tolist(), settings)
    asked = sum(seen.evaluations for seen in found) + sum(len(ids) for ids, _ in mates)
    return freeze(graph, links, changed, graph.evaluations + asked)


def _search_before(graph: Graph, nodes: Ids, distance: Distance) -> list[Found]:
    """What each of `nodes` finds in the graph as it was before their generation."""
    settings = graph.settings
    if not graph.before:
        return [Found(np.zeros(0, np.int64), np.zeros(0), 0) for _ in nodes]
    walks = []
    for node in nodes.tolist():
        rng = stream(settings.seed, "insert", node)
        starts = draw_starts(len(graph.before), settings.starts, rng, repeat=settings.printed)
        if settings.printed:
            walks.append(printed(graph.before, starts, settings.f))
        else:
            walks.append(best_first(graph.before, starts, max(settings.ef, settings.f)))
    return lockstep(walks, lambda rows, ids: distance.pairs(nodes[rows], ids), settings.f)


def _measure_mates(first: int, nodes: Ids, distance: Distance) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each of `nodes` the members of its generation with a smaller id, and the distances to them."""
    mates = [np.arange(first, node) for node in nodes]
    rows = np.repeat(nodes, [len(ids) for ids in mates])
    if not len(rows):
        return [(ids, np.zeros(0)) for ids in mates]
    distances = np.asarray(distance.pairs(rows, np.concatenate(mates)), dtype=np.float64)
    cuts = np.cumsum([len(ids) for ids in mates])[:-1]
    return list(zip(mates, np.split(distances, cuts), strict=True))

import numpy as np
import pytest
from index_measure import build_as_printed, recall

from dynreg.errors import UsageError
from dynreg.index import Graph, GraphSettings, brute_force, build, search, search_many, search_printed
from dynreg.rng import stream


@pytest.fixture(scope="module")
def graph(nodes):
    return build(nodes, len(nodes))


def _one(to, row):
    return lambda ids: to(np.full(len(ids), row), ids)


def _same(found, other):
    np.testing.assert_array_equal(found.ids, other.ids)
    np.testing.assert_array_equal(found.distances, other.distances)


def test_brute_force_sorts_everything_and_ties_go_by_id():
    distances = np.array([2.0, 1.0, 3.0, 1.0, 0.5])
    found = brute_force(lambda ids: distances[ids], 5, 4)
    assert found.ids.tolist() == [4, 1, 3, 0]
    assert found.evaluations == 5


def test_search_that_keeps_every_node_is_brute_force(graph, to, tables):
    n, queries = len(graph), len(tables[1])
    for row, found in enumerate(search_many(graph, to, queries, 5, seed=3, ef=n)):
        _same(found, brute_force(_one(to, row), n, 5))
        assert found.evaluations == n


def test_lockstep_changes_no_search(graph, to, tables):
    together = search_many(graph, to, len(tables[1]), 5, seed=3)
    for row, found in enumerate(together):
        alone = search(graph, _one(to, row), 5, stream(3, "search", row))
        _same(alone, found)
        assert alone.evaluations == found.evaluations


def test_search_finds_nearly_all_and_is_no_brute_force(graph, to, tables):
    found = search_many(graph, to, len(tables[1]), 5, seed=3)
    assert recall(found, tables[1], 5) >= 0.99
    assert max(one.evaluations for one in found) < len(graph) / 2


def test_evaluations_are_what_was_asked_and_each_node_is_asked_once(graph, query_spy):
    found = search_many(graph, query_spy.pairs, 7, 5, seed=3)
    asked = np.concatenate(query_spy.asked, axis=1)
    assert np.unique(asked, axis=1).shape == asked.shape
    assert [one.evaluations for one in found] == np.bincount(asked[0]).tolist()


def test_lockstep_makes_calls_larger(graph, query_spy):
    search_many(graph, query_spy.pairs, 7, 5, seed=3)
    assert query_spy.count / len(query_spy.asked) > 7


def test_algorithm_1_ends_in_a_local_minimum_of_every_restart(nodes, query_spy, tables):
    graph = build_as_printed(nodes, 300)
    for row in range(10):
        query_spy.asked.clear()
        found = search_printed(graph, _one(query_spy.pairs, row), 5, stream(0, "walk", row))
        asked = np.concatenate(query_spy.asked, axis=1)[1]
        assert found.evaluations == len(asked) == len(np.unique(asked))
        assert set(found.ids) <= set(asked)
        best = int(found.ids[0])
        assert found.distances[0] == tables[1][row, asked].min()  # the best seen is never lost
        assert found.distances[0] <= tables[1][row, graph.neighbours[best]].min()  # nowhere to go from there


def test_algorithm_1_by_hand_on_a_line():
    """Nodes on a line, links to the next on either side, a query at node 0: the walk goes down to it."""
    links = tuple(np.array([j for j in (i - 1, i + 1) if 0 <= j < 6]) for i in range(6))
    line = Graph(GraphSettings(batch=1), links, tuple(np.ones(len(ids)) for ids in links), links)
    found = search_printed(line, lambda ids: ids.astype(float), 2, np.random.default_rng(0), restarts=1)
    start = int(np.random.default_rng(0).integers(6, size=1)[0])
    assert found.ids.tolist() == [0, 1]
    assert found.evaluations == min(start + 2, 6)


def test_a_graph_smaller_than_k_returns_all(nodes, to):
    graph = build(nodes, 3)
    assert sorted(search(graph, _one(to, 0), 5, stream(0, "q")).ids) == [0, 1, 2]


def test_what_cannot_be_searched_is_refused(graph, to):
    with pytest.raises(UsageError, match="empty"):
        search(Graph(GraphSettings()), _one(to, 0), 5, stream(0, "q"))
    with pytest.raises(UsageError, match="NaN"):
        search(graph, lambda ids: np.full(len(ids), np.nan), 5, stream(0, "q"))

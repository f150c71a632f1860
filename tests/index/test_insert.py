"""Walks among some of the nodes, and graphs whose nodes come with their nearest."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.index import Graph, GraphSettings, build, insert, search
from dynreg.rng import stream


def measured(tables, n):
    return [(np.arange(i), tables[0][i, :i]) for i in range(n)]


@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_only_nodes_among_those_allowed_are_asked_for_and_found(nodes, tables, query_spy, share):
    graph, recalls = build(nodes, len(nodes)), []
    allowed = np.sort(stream(0, "allowed").choice(len(nodes), int(share * len(nodes)), replace=False))
    for row in range(20):
        query_spy.asked.clear()
        to = lambda ids, row=row: query_spy.pairs(np.full(len(ids), row), ids)  # noqa: E731
        found = search(graph, to, 5, stream(row, "walk"), ef=40, among=allowed)
        asked = np.concatenate([call[1] for call in query_spy.asked])
        assert np.isin(asked, allowed).all() and found.evaluations == len(asked) == len(set(asked.tolist()))
        right = allowed[np.argsort(tables[1][row, allowed], kind="stable")[:5]]
        recalls.append(np.isin(right, found.ids).mean())
    assert np.mean(recalls) > 0.9


def test_nodes_with_their_nearest_make_a_graph_that_can_be_walked(tables):
    graph = insert(Graph(GraphSettings(batch=1)), measured(tables, 300))
    assert len(graph) == 300 and graph.evaluations == 300 * 299 // 2
    assert graph.degree.max() <= graph.settings.degree_cap
    to = lambda ids: tables[1][0, ids]  # noqa: E731
    found = search(graph, to, 5, stream(0, "walk"), ef=60)
    assert np.isin(found.ids, np.argsort(tables[1][0, :300])[:8]).all()


@pytest.mark.parametrize("near", [[(np.arange(0), np.zeros(0))] * 2, [(np.arange(1), np.array([np.nan]))]])
def test_a_node_without_neighbours_is_refused(tables, near):
    begun = insert(Graph(GraphSettings(batch=1)), measured(tables, 1))
    with pytest.raises(UsageError, match="candidates"):
        insert(begun, near)


def test_generations_of_many_nodes_are_not_inserted_into(nodes):
    with pytest.raises(UsageError, match="batch = 1"):
        insert(build(nodes, 40), [(np.arange(40), np.ones(40))])

"""Graphs whose nodes come with their nearest."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.index import Graph, GraphSettings, build, insert, search
from dynreg.rng import stream


def measured(tables, n):
    return [(np.arange(i), tables[0][i, :i]) for i in range(n)]


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

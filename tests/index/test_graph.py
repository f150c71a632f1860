import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from index_entries import MatrixDistance
from index_measure import build_as_printed
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from dynreg.errors import CorruptError, UsageError
from dynreg.index import NO_CAP, Graph, GraphSettings, build, extend


def strong_parts(graph):
    """How many parts there are between which one cannot go both ways."""
    n = len(graph)
    rows = np.repeat(np.arange(n), graph.degree)
    table = csr_matrix((np.ones(len(rows)), (rows, np.concatenate(graph.neighbours))), shape=(n, n))
    return connected_components(table, connection="strong")[0]


def assert_same(one, other):
    assert one.settings == other.settings and one.evaluations == other.evaluations
    for name in ("neighbours", "lengths", "before"):
        assert len(getattr(one, name)) == len(getattr(other, name))
        for a, b in zip(getattr(one, name), getattr(other, name), strict=True):
            np.testing.assert_array_equal(a, b)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(2, 70),
    st.integers(1, 4),
    st.integers(1, 3),
    st.integers(1, 9),
    st.integers(0, 10**6),
    st.sampled_from(["noise", "star", "equal"]),
)
def test_pruning_cuts_nothing_off(n, f, room, batch, seed, shape):
    """Whatever the distances (here without any geometry), and however tight the cap."""
    rng = np.random.default_rng(seed)
    matrix = {"noise": rng.random((n, n)), "star": np.ones((n, n)), "equal": np.ones((n, n))}[shape]
    if shape == "star":
        matrix[:, 0] = 0.1
    graph = build(
        MatrixDistance(matrix), n, GraphSettings(f=f, ef=f, degree_cap=f + room, batch=batch, starts=1)
    )
    assert strong_parts(graph) == 1
    assert graph.degree.max() <= f + room
    assert graph.degree.min() >= 1


def test_the_cap_is_respected_and_needed(nodes):
    capped, free = build(nodes, len(nodes)), build(nodes, len(nodes), GraphSettings(degree_cap=NO_CAP))
    assert capped.degree.max() <= 20 < 2 * 20 < free.degree.max()
    assert strong_parts(capped) == strong_parts(free) == 1


def test_links_are_mutual_without_a_cap_and_lengths_are_the_distances(nodes, tables):
    for graph in (
        build(nodes, 200, GraphSettings(degree_cap=NO_CAP)),
        build_as_printed(nodes, 200),
        build(nodes, 200),
    ):
        links = {(i, int(j)) for i in range(200) for j in graph.neighbours[i]}
        assert all(i != j for i, j in links)
        if graph.settings.degree_cap < 0:
            assert links == {(j, i) for i, j in links}
        for node in range(200):
            ids, lengths = graph.neighbours[node], graph.lengths[node]
            assert len(set(ids.tolist())) == len(ids)
            assert np.all(np.diff(lengths) >= 0)
            np.testing.assert_allclose(lengths, tables[0][ids, node])


def test_building_repeats_itself_and_the_seed_matters(nodes):
    one, same, other = (build(nodes, 200, GraphSettings(seed=seed, f=3, ef=3)) for seed in (4, 4, 5))
    assert_same(one, same)
    assert any(not np.array_equal(a, b) for a, b in zip(one.neighbours, other.neighbours, strict=True))


@settings(deadline=None, max_examples=10)
@given(st.lists(st.integers(0, 120), max_size=3), st.integers(1, 40), st.booleans())
def test_extending_is_building(nodes, stops, batch, stored):
    grown = build(nodes, 0, GraphSettings(batch=batch))
    for stop in sorted(stops):
        grown = extend(grown, nodes, stop)
        grown = Graph.from_arrays(grown.to_arrays()) if stored else grown
    assert_same(extend(grown, nodes, 120), build(nodes, 120, GraphSettings(batch=batch)))


@pytest.mark.parametrize("batch", [1, 32])
def test_building_counts_what_it_asks(spy, batch):
    graph = build(spy, 200, GraphSettings(batch=batch))
    asked = np.concatenate(spy.asked, axis=1)
    assert graph.evaluations == spy.count == np.unique(asked, axis=1).shape[1]
    assert np.all(asked[0] > asked[1])  # a new node against older ones


def test_a_generation_shares_its_calls(spy):
    build(spy, 320)
    assert spy.count / len(spy.asked) > 64


@pytest.mark.parametrize("n", [0, 1, 31, 64, 100])
def test_arrays_round_trip_through_npz(nodes, n, tmp_path):
    graph = build(nodes, n, GraphSettings(seed=7))
    np.savez(tmp_path / "graph.npz", **graph.to_arrays())
    with np.load(tmp_path / "graph.npz", allow_pickle=False) as stored:
        assert_same(Graph.from_arrays(stored), graph)


@pytest.mark.parametrize("name", ["settings", "degree", "neighbours", "lengths", "before_degree", "before"])
def test_stored_arrays_that_are_cut_or_missing_are_corrupt(nodes, name):
    arrays = build(nodes, 100).to_arrays()
    for broken in ({**arrays, name: arrays[name][:-1]}, {k: v for k, v in arrays.items() if k != name}):
        with pytest.raises(CorruptError):
            Graph.from_arrays(broken)


def test_a_stored_link_to_no_node_is_corrupt(nodes):
    arrays = build(nodes, 100).to_arrays()
    arrays["neighbours"][3] = 100
    with pytest.raises(CorruptError):
        Graph.from_arrays(arrays)


@pytest.mark.parametrize("bad", [{"f": 0}, {"degree_cap": 10}, {"batch": 0}, {"seed": -1}])
def test_settings_that_cannot_work_are_refused(bad):
    with pytest.raises(UsageError):
        GraphSettings(**bad)


def test_a_graph_grows_neither_down_nor_past_its_distance(nodes):
    for n in (10, len(nodes) + 1):
        with pytest.raises(UsageError):
            extend(build(nodes, 20), nodes, n)


def test_bookkeeping_is_cheap(nodes):
    """Well under 5 ms for an insertion whose distances cost nothing."""
    started = time.process_time()
    build(nodes, len(nodes))
    assert time.process_time() - started < 0.005 * len(nodes)

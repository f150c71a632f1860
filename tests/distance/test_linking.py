"""Links by candidates: those of many calls are those of one, they are nearly the nearest, and they can be walked."""

import numpy as np
import pytest

from dynreg.distance.cross_loss import CrossLoss, own_losses
from dynreg.distance.embedding import fit_embedding
from dynreg.distance.linking import candidates, link_entries, new_graph
from dynreg.index import search
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.rng import stream

N, ROWS = 200, 24


@pytest.fixture(scope="module")
def entries() -> MlpStack:
    """Models that differ from one along three directions of their last biases and weights."""
    base, rng = initial(4, 3, 1, seed=9), stream(0, "linked family")
    weights, biases = (
        [np.repeat(w, N, axis=0) for w in base.weights],
        [np.repeat(b, N, axis=0) for b in base.biases],
    )
    biases[-1] = biases[-1] + rng.uniform(-1, 1, biases[-1].shape)
    weights[-1] = weights[-1] * rng.uniform(0.5, 1.5, (N, 1, 1))
    return MlpStack(tuple(weights), tuple(biases))


@pytest.fixture(scope="module")
def distance(entries) -> CrossLoss:
    rng = stream(0, "linked rows")
    inputs = rng.normal(size=(N, ROWS, 4)).astype(np.float32)
    clean = np.stack([predict(entries[np.array([i])], inputs[i])[0] for i in range(N)])
    targets = clean + 0.1 * rng.normal(size=clean.shape).astype(np.float32)
    return CrossLoss(entries, inputs, targets, own_losses(entries, inputs, targets), threads=1)


@pytest.fixture(scope="module")
def vectors(entries) -> np.ndarray:
    probes = stream(0, "probes").normal(size=(32, 4)).astype(np.float32)
    return fit_embedding(entries, initial(4, 3, 1, seed=9), probes).vectors(entries)


def same(one, other) -> bool:
    a, b = one.to_arrays(), other.to_arrays()
    return all(np.array_equal(a[name], b[name]) for name in a)


def linked(vectors, distance, n, threads=1, before=None):
    return link_entries(before or new_graph(0), vectors[:n], distance, threads)


@pytest.mark.parametrize("stops", [[100], [1, 63, 64, 190]])
def test_a_graph_that_grew_is_the_graph_of_all_at_once(vectors, distance, stops):
    grown = new_graph(0)
    for stop in stops:
        grown = linked(vectors, distance, stop, before=grown)
    assert same(linked(vectors, distance, N, before=grown), linked(vectors, distance, N))


def test_the_number_of_threads_changes_no_byte(vectors, distance):
    assert same(linked(vectors, distance, N, threads=1), linked(vectors, distance, N, threads=3))


def test_candidates_are_the_nearest_before_each_entry(vectors):
    for entry, found in enumerate(candidates(vectors, 0, 5)):
        apart = np.linalg.norm(vectors[:entry] - vectors[entry], axis=1)
        np.testing.assert_array_equal(found, np.sort(np.argsort(apart)[:5]))


def test_links_are_nearly_the_nearest_by_cross_loss_and_a_walk_finds_them(vectors, distance):
    graph, matrix = linked(vectors, distance, N), distance.matrix()
    assert graph.evaluations < N * 24 and (graph.degree <= graph.settings.degree_cap).all()
    recalls = []
    for entry in range(0, N, 5):
        right = np.argsort(matrix[entry], kind="stable")[:5]
        found = search(graph, lambda ids, e=entry: matrix[e, ids], 5, stream(entry, "walk"), ef=40)
        recalls.append(np.isin(found.ids, right).mean())
    assert np.mean(recalls) > 0.95

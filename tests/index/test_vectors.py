import subprocess
import sys
import threading
from importlib.util import find_spec

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.index import vector_index

HNSW = pytest.param(
    "hnsw", marks=pytest.mark.skipif(find_spec("hnswlib") is None, reason="hnswlib is not installed")
)
KINDS = ["exact", HNSW]


@pytest.fixture(scope="module")
def vectors():
    return np.random.default_rng(1).normal(size=(3000, 24))


@pytest.fixture(scope="module")
def queries():
    return np.random.default_rng(2).normal(size=(60, 24))


def _filled(kind, vectors, seed=0):
    index = vector_index(vectors.shape[1], kind=kind, seed=seed)
    index.add(vectors[:700])
    index.add(vectors[700:])
    return index


def _oracle(vectors, queries, k):
    distances = np.linalg.norm(queries[:, None] - vectors, axis=2)
    return np.argsort(distances, axis=1, kind="stable")[:, :k], np.sort(distances, axis=1)[:, :k]


def test_exact_is_brute_force(vectors, queries):
    ids, distances = _filled("exact", vectors).nearest(queries, 10)
    expected_ids, expected = _oracle(vectors, queries, 10)
    np.testing.assert_array_equal(ids, expected_ids)
    np.testing.assert_allclose(distances, expected)


def test_exact_survives_a_large_offset_and_orders_ties_by_id():
    vectors = 1e6 + np.repeat(np.arange(5.0), 4)[:, None] * [1.0, 0.0]
    index = vector_index(2, kind="exact")
    index.add(vectors)
    ids, distances = index.nearest(np.array([[1e6 + 2.1, 1e6]]), 6)
    assert ids.tolist() == [[8, 9, 10, 11, 12, 13]]
    np.testing.assert_allclose(distances[0, :5], [0.1] * 4 + [0.9], atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_recalls_the_exact_neighbours(kind, vectors, queries):
    ids, distances = _filled(kind, vectors).nearest(queries, 10)
    _, expected = _oracle(vectors, queries, 10)
    assert np.mean(distances <= expected[:, -1:] * (1 + 1e-6)) >= 0.99
    assert np.all(np.diff(distances, axis=1) >= 0)
    true = np.linalg.norm(vectors[ids] - queries[:, None], axis=2)
    np.testing.assert_allclose(distances, true, rtol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_repeats_itself(kind, vectors, queries):
    first, second = (_filled(kind, vectors).nearest(queries, 10) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_serves_the_empty_and_the_small(kind):
    index = vector_index(3, kind=kind)
    assert index.nearest(np.zeros((2, 3)), 5)[0].shape == (2, 0)
    index.add(np.eye(3))
    ids, distances = index.nearest(np.array([[0.9, 0.1, 0.0]]), 5)
    assert len(index) == 3 and ids.tolist() == [[0, 1, 2]]
    assert index.nearest(np.zeros((0, 3)), 2)[0].shape == (0, 2)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_refuses_what_is_no_vector(kind):
    index = vector_index(3, kind=kind)
    for bad in (np.zeros((2, 4)), np.zeros(3), np.full((1, 3), np.nan)):
        with pytest.raises(UsageError):
            index.add(bad)
    with pytest.raises(UsageError):
        index.nearest(np.zeros((1, 3)), 0)


@pytest.mark.parametrize("kind", [HNSW])
def test_hnsw_may_be_asked_while_it_grows(kind, vectors, queries):
    index = vector_index(24, kind=kind)
    index.add(vectors[:100])
    failures = []

    def ask():
        try:
            while len(index) < len(vectors):
                ids, _ = index.nearest(queries, 5)
                assert ids.shape == (60, 5) and ids.max() < len(vectors)
        except Exception as error:  # the thread must not swallow it
            failures.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    for at in range(100, len(vectors), 290):
        index.add(vectors[at : at + 290])
    thread.join()
    assert not failures
    assert len(index) == len(vectors)


def test_without_hnswlib_exact_serves_and_hnsw_says_what_to_install(monkeypatch):
    monkeypatch.setattr("dynreg.index.vectors.find_spec", lambda name: None)
    assert type(vector_index(3)).__name__ == "ExactVectors"
    with pytest.raises(UsageError, match=r"dynreg\[hnsw\]"):
        vector_index(3, kind="hnsw")


def test_importing_the_index_loads_nothing_heavy():
    heavy = "{'torch', 'hnswlib', 'sklearn', 'scipy', 'mujoco'}"
    code = f"import sys, dynreg.index; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

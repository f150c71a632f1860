import numpy as np
import pytest
from index_entries import MatrixDistance
from index_measure import recall
from landmarks import Landmarks, build_landmarks, extend_landmarks, refine, search_landmarks

from dynreg.errors import UsageError
from dynreg.index import brute_force, build


@pytest.fixture(scope="module")
def landmarks(nodes):
    return build_landmarks(nodes, len(nodes), m=64)


@pytest.mark.parametrize("farthest", [False, True])
def test_ridge_finds_nearly_all_and_beats_plain_descriptions(nodes, to, tables, farthest):
    landmarks = build_landmarks(nodes, len(nodes), m=64, farthest=farthest)
    ridge = search_landmarks(landmarks, to, len(tables[1]), 5)
    plain = search_landmarks(landmarks, to, len(tables[1]), 5, score=Landmarks.apart)
    assert recall(ridge, tables[1], 5) >= 0.97
    assert recall(ridge, tables[1], 5) > recall(plain, tables[1], 5) + 0.2


def test_a_query_costs_landmarks_and_reranked_alone(landmarks, query_spy, tables):
    found = search_landmarks(landmarks, query_spy.pairs, 6, 5, rerank=30)
    asked = np.concatenate(query_spy.asked, axis=1)
    assert {one.evaluations for one in found} == {64 + 30} == set(np.bincount(asked[0]).tolist())
    assert np.unique(asked, axis=1).shape == asked.shape
    assert len(query_spy.asked) == 2
    for row, one in enumerate(found):
        np.testing.assert_array_equal(one.distances, tables[1][row, one.ids])


def test_describing_costs_n_times_m(spy):
    build_landmarks(spy, 100, m=10)
    assert spy.count == 1000
    build_landmarks(spy, 100, m=10, symmetric=False)
    assert spy.count == 3000


def test_reranking_everyone_is_brute_force(landmarks, to, tables):
    n = len(landmarks)
    for row, found in enumerate(search_landmarks(landmarks, to, 10, 5, rerank=n)):
        oracle = brute_force(lambda ids, row=row: to(np.full(len(ids), row), ids), n, 5)
        np.testing.assert_array_equal(found.ids, oracle.ids)
        assert found.evaluations == n


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_fewer_entries_than_landmarks_are_all_measured(nodes, to, tables, n):
    found = search_landmarks(build_landmarks(nodes, n), to, 4, 5)
    assert recall(found, tables[1][:4, :n], 5) == 1.0


def test_predictions_recover_a_planted_linear_law():
    """log d(a, b) = u_a . v_b + c_b has rank 4 and a constant: 20 landmarks tell all of it."""
    rng = np.random.default_rng(0)
    logs = rng.normal(size=(220, 3)) @ rng.normal(size=(3, 200)) + rng.normal(size=200)
    matrix = np.exp(logs)
    landmarks = build_landmarks(MatrixDistance(matrix[:200]), 200, m=20, symmetric=False)
    predicted = landmarks.predict(logs[200:, landmarks.ids])
    assert np.sqrt(np.mean((predicted - logs[200:]) ** 2)) < 0.05 * logs.std()


def test_extending_describes_as_building_did_and_moves_no_one(nodes, to):
    short = build_landmarks(nodes, 300, m=32)
    long = extend_landmarks(short, nodes, 600)
    np.testing.assert_array_equal(long.weights[:, :300], short.weights)
    logs = np.log(to(np.zeros(32, int), short.ids))[None]
    np.testing.assert_allclose(long.predict(logs)[:, :300], short.predict(logs))
    error = long.predict(logs)[0] - np.log(to(np.zeros(600, int), np.arange(600)))
    assert np.std(error[300:]) < 1.5 * np.std(error[:300])


def test_known_distances_refine_the_predictions(nodes, landmarks, to, tables):
    graph = build(nodes, len(nodes))
    a, b = np.concatenate(graph.neighbours), np.repeat(np.arange(len(nodes)), graph.degree)
    refined = refine(landmarks, a, b, tables[0][a, b])
    queries = len(tables[1])
    before = recall(search_landmarks(landmarks, to, queries, 5, rerank=15), tables[1], 5)
    after = recall(search_landmarks(refined, to, queries, 5, rerank=15), tables[1], 5)
    assert after > before


def test_refining_with_nothing_new_changes_nothing(landmarks, tables):
    """Neither a landmark's distances nor an entry's to itself are news, even among pairs that are."""
    old = np.repeat(landmarks.ids, 2), np.tile([2, 5], len(landmarks.ids))
    np.testing.assert_array_equal(refine(landmarks, *old, tables[0][old]).weights, landmarks.weights)
    others = np.setdiff1d(np.arange(20), landmarks.ids)
    new = others[:6], others[1:7]
    mixed = tuple(np.concatenate([*ids, others]) for ids in zip(old, new, strict=True))
    expected = refine(landmarks, *new, tables[0][new]).weights
    np.testing.assert_array_equal(refine(landmarks, *mixed, tables[0][mixed]).weights, expected)
    assert np.array_equal(expected[:, 2], landmarks.weights[:, 2]) == (2 not in new[1])


def test_what_has_no_logarithm_is_refused():
    matrix = np.ones((5, 5))
    matrix[3, 1] = matrix[1, 3] = 0.0
    with pytest.raises(UsageError, match=r"0\.0 from [13] to [13]"):
        build_landmarks(MatrixDistance(matrix), 5)
    with pytest.raises(UsageError):
        build_landmarks(MatrixDistance(matrix), 0)

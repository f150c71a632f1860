"""The nearest are found by judging few, whatever some models predict; nobody is judged twice."""

import numpy as np
import pytest

from dynreg.distance.foreseen import Effort, gaussian, linear, seek
from dynreg.distance.linked import EMBEDDED, effort, link_lengths, places
from dynreg.index import Graph, GraphSettings
from dynreg.rng import stream

N, DIMENSIONS, FEATURES = 2000, 12, 40


class Planted:
    """Entries whose misses are nearly linear in their vectors; the query is where they miss nothing but noise."""

    def __init__(self, seed: int, lost: float = 0.0, lost_as: float = np.nan):
        rng = stream(seed, "planted misses")
        self.vectors = rng.normal(size=(N, DIMENSIONS))
        slope = rng.normal(size=(DIMENSIONS, FEATURES)) / FEATURES
        level = 0.7 * rng.normal(size=DIMENSIONS) @ slope
        self.misses = (self.vectors @ slope - level + 0.002 * rng.normal(size=(N, FEATURES))).astype(
            np.float32
        )
        gone = rng.random(N) < lost
        self.misses[gone] = lost_as * rng.normal(size=(gone.sum(), FEATURES))
        far = np.abs(self.misses).sum(axis=1, dtype=float)
        self.far = np.where(np.isnan(far), np.inf, far)
        self.asked: list[int] = []

    def missed(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.asked += ids.tolist()
        return self.misses[ids], self.far[ids]

    def found(self, wanted: int = 1, n: int = N):
        first = stream(0, "seek").permutation(n)[:32]
        return seek(
            self.vectors[:n],
            self.missed,
            wanted,
            first,
            Effort(linear(ridge=1.0), least=160, near=500, beside=0.25),
        )


@pytest.mark.parametrize("lost, lost_as", [(0.0, np.nan), (0.5, np.nan), (0.5, 1e4)])
def test_the_nearest_are_found_by_judging_few_though_some_models_predict_no_number_or_diverge(lost, lost_as):
    recalls = []
    for seed in range(8):
        planted = Planted(seed, lost, lost_as)
        found = planted.found()
        recalls.append(np.isin(np.argsort(planted.far, kind="stable")[:5], found.order[:5]).mean())
        assert found.evaluations < N / 5 and (np.diff(found.distance[np.isfinite(found.distance)]) >= 0).all()
        np.testing.assert_array_equal(found.distance, planted.far[found.order])
    assert np.mean(recalls) >= 0.95


def test_the_nearest_are_found_where_all_are_far():
    """Distances of robots whose sensors have little noise begin at 3 or more."""
    recalls = []
    for seed in range(4):
        planted = Planted(seed)
        planted.far *= 12.0 / planted.far.min()
        recalls.append(np.isin(np.argsort(planted.far)[:5], planted.found().order[:5]).mean())
    assert np.mean(recalls) >= 0.95


def test_one_that_misses_nearly_nothing_leaves_others_to_learn_from():
    """None of the others is within a multiple of its distance."""
    recalls = []
    for seed in range(4):
        planted = Planted(seed)
        planted.far /= np.median(planted.far)
        planted.far[np.argmin(planted.far)] = 1e-9
        recalls.append(np.isin(np.argsort(planted.far)[:5], planted.found().order[:5]).mean())
    assert np.mean(recalls) >= 0.95


def test_each_is_judged_once_and_all_that_are_judged_are_told():
    planted = Planted(1)
    found = planted.found()
    assert sorted(planted.asked) == sorted(found.order.tolist())
    assert len(set(planted.asked)) == len(planted.asked) == found.evaluations


@pytest.mark.parametrize(("wanted", "n"), [(500, N), (1, 20), (50, 20), (1, 0)])
def test_as_many_are_judged_as_are_wanted_where_there_are_so_many(wanted, n):
    found = Planted(2).found(wanted, n)
    assert min(wanted, n) <= len(found.order) <= n


def test_entries_that_all_predict_no_number_are_all_judged_and_none_is_near():
    planted = Planted(3, lost=1.1)
    assert np.isinf(planted.found(n=200).distance).all() and len(planted.asked) == 200


def test_the_same_draws_find_the_same():
    one, other = Planted(4).found(), Planted(4).found()
    np.testing.assert_array_equal(one.order, other.order)


def test_an_entry_whose_model_predicts_no_number_leaves_the_places_of_the_others():
    vectors, own = Planted(5).vectors[:20], np.ones(20)
    lost = vectors.copy()
    lost[7] = np.nan
    others = np.arange(20) != 7
    right = places(vectors[others], own[others], own[others], own[others])
    np.testing.assert_array_equal(places(lost, own, own, own)[others], right)


def test_a_place_tells_the_embedding_the_logarithm_of_the_own_loss_and_the_length_of_links():
    vectors, rng = Planted(6).vectors[:9], stream(6, "own losses and hubs")
    own, hub = np.exp(rng.normal(size=9)), rng.uniform(1.0, 2.0, 9)
    like = rng.uniform(size=9)
    found = places(vectors, own, hub, like)
    np.testing.assert_allclose(found[:, :-3].var(axis=0).sum(), EMBEDDED**2)
    for column, told in zip(found[:, -3:].T, (np.log(own), hub, like), strict=True):
        np.testing.assert_allclose(column, (told - told.mean()) / told.std(), rtol=1e-6)
    np.testing.assert_allclose(
        found, places(vectors, own, 7.0 * hub, like), err_msg="whatever the unit of lengths"
    )


def test_a_process_foresees_what_is_not_linear():
    rng = stream(7, "bumps")
    places = rng.uniform(-1.0, 1.0, size=(1500, 3)).astype(np.float32)
    missed = np.log(0.1 + np.square(places).sum(axis=1))[:, None].astype(np.float32)
    ids, others = np.arange(300), np.arange(300, 1500)
    foresee = gaussian(reach=1.0, noise=0.01, slope=0.1)(places)
    for many in (200, 300):  # the second time it knows more
        found = foresee(ids[:many], missed[:many], others)
        assert np.corrcoef(found, missed[others, 0])[0, 1] > 0.97
    np.testing.assert_allclose(
        found, gaussian(1.0, 0.01, 0.1)(places)(ids, missed[ids], others), rtol=1e-4, atol=1e-4
    )
    flat = linear(ridge=1e-6)(places)(ids, missed[ids], others)
    assert abs(np.corrcoef(flat, np.abs(missed[others, 0]))[0, 1]) < 0.5
    bowl = seek(
        places,
        lambda at: (missed[at], np.exp(missed[at, 0])),
        5,
        ids[:32],
        Effort(gaussian(1.0, 0.01, 0.1), least=96),
    )
    assert set(np.argsort(missed[:, 0])[:5]) <= set(bowl.order[:5])


def test_the_length_of_an_entrys_links_is_the_median_of_those_that_were_measured():
    rng = stream(5, "lengths")
    lengths = [rng.uniform(size=n) for n in (4, 4, 0, 1, 2)]
    lengths[1][2] = np.inf
    lengths[4][:] = np.inf  # none of these was measured
    nodes = tuple(np.zeros(len(one), dtype=int) for one in lengths)
    found = link_lengths(Graph(GraphSettings(), nodes, tuple(lengths), nodes, 0))
    told = [np.median(one[np.isfinite(one)]) for one in (lengths[0], lengths[1], lengths[3])]
    assert found[[0, 1, 3]].tolist() == told and found[2] == found[4] == np.median(told)


def test_a_search_by_cross_loss_judges_a_smaller_share_of_more_entries():
    spent = [effort(n).least for n in (400, 4_000, 40_000)]
    assert spent[0] == 250 and spent[0] < spent[1] < spent[2] < 3 * spent[0]

"""The nearest are found by judging few, whatever some models predict; nobody is judged twice."""

import numpy as np
import pytest

from dynreg.distance.foreseen import Effort, gaussian, linear, seek
from dynreg.distance.linked import SPREAD, effort, hardness, places
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
    vectors, own, hard = Planted(5).vectors[:20], np.ones(20), Planted(6).vectors[:20, :4]
    others = ~np.isin(np.arange(20), (7, 9))
    right = places(vectors[others], own[others], hard[others], own[others])
    lost, blown = vectors.copy(), own.copy()
    lost[7], blown[9] = np.nan, np.inf
    np.testing.assert_array_equal(places(lost, blown, hard, own)[others], right)


def test_a_place_tells_the_embedding_how_hard_the_rows_are_the_own_loss_and_the_likeness():
    vectors, rng = Planted(6).vectors[:9], stream(6, "own losses and pivots")
    own, like, hard = np.exp(rng.normal(size=9)), rng.uniform(size=9), rng.normal(size=(9, 3))
    found = places(vectors, own, hard, like)
    size = vectors.shape[1]
    for told, columns in ((vectors, found[:, :size]), (hard, found[:, size:-2])):
        np.testing.assert_allclose(columns.var(axis=0).sum(), SPREAD**2)
        alike = (told - told.mean(axis=0)) / np.sqrt(told.var(axis=0).sum())
        np.testing.assert_allclose(columns, SPREAD * alike, err_msg="in one unit, not each in its own")
    for column, told in zip(found[:, -2:].T, (np.log(own), like), strict=True):
        np.testing.assert_allclose(column, (told - told.mean()) / told.std(), rtol=1e-6)


def test_rows_are_hard_that_pivots_predict_worse_than_their_own_model():
    own = np.array([0.5, 2.0, 1.0])
    crossed = own[:, None] * np.exp([[0.1, 0.4], [0.2, 0.5], [0.3, 0.6]])
    np.testing.assert_allclose(hardness(own, crossed), [[0.1, 0.4], [0.2, 0.5], [0.3, 0.6]], rtol=1e-9)
    own[1], crossed[1] = np.inf, np.nan  # an entry that is lost anyway says nothing of pivots
    np.testing.assert_allclose(hardness(own, crossed)[[0, 2]], [[0.1, 0.4], [0.3, 0.6]], rtol=1e-9)
    crossed[2, 1] = np.nan
    np.testing.assert_allclose(hardness(own, crossed)[[0, 2]], [[0.1, 0.0], [0.3, 0.0]], rtol=1e-9)


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


def test_a_process_that_leaves_out_what_it_knew_foresees_as_one_that_never_knew_it():
    rng = stream(10, "left out")
    places = rng.normal(size=(200, 3)).astype(np.float32)
    missed = rng.normal(size=(200, 1)).astype(np.float32)
    ids, others = np.arange(50), np.arange(100, 200)
    foresee, anew = (gaussian(1.0, 0.1, 0.1)(places) for _ in range(2))
    foresee(ids[:20], missed[:20], others)
    some = ids[ids % 3 > 0]  # the others turn out to be too far to learn from
    np.testing.assert_allclose(
        foresee(some, missed[some], others), anew(some, missed[some], others), rtol=1e-3, atol=1e-4
    )


def test_a_process_foresees_a_slope_beyond_its_reach_and_a_level_that_few_of_the_judged_have():
    places = np.linspace(-3.0, 3.0, 61, dtype=np.float32)[:, None]
    missed = 2.0 + 0.5 * places
    known, far = np.arange(20, 41), np.array([0, 60])
    low, high = gaussian(reach=0.2, noise=1e-4, slope=1.0)(places)(known, missed[known], far)
    assert high * missed[known].std() == pytest.approx(1.5, rel=0.3) and low == pytest.approx(-high, rel=1e-3)
    # of a crowd and three that stand alone: far from all a miss is near the mean of four places, not of 43
    places = np.append(np.zeros((40, 4)), 4.0 * np.eye(4), axis=0).astype(np.float32)
    places[:40] += stream(8, "crowd").normal(scale=0.02, size=(40, 4))
    missed = np.append(np.zeros(40), np.ones(3))[:, None].astype(np.float32)
    foresee = gaussian(reach=1.0, noise=0.1, slope=0.1)(places)
    (found,) = foresee(np.arange(43), missed, np.array([43])) * missed.std() + missed.mean()
    assert found > 0.3 > 4 * missed.mean()


def test_some_of_those_beside_the_best_are_judged_though_they_are_foreseen_to_be_far():
    rng = stream(9, "beside")
    places = rng.uniform(-1.0, 1.0, size=(400, 2)).astype(np.float32)
    first = np.arange(32)
    far = 1.0 + np.square(places - places[5]).sum(axis=1)  # the best is the sixth
    asked: list[np.ndarray] = []

    def missed(at):
        asked.append(at)
        return far[at][:, None].astype(np.float32), far[at]

    def misled(_):  # foresees the farthest first
        return lambda ids, misses, others: -far[others]

    beside = np.argsort(np.square(places - places[5]).sum(axis=1))
    beside = beside[~np.isin(beside, first)][:4]
    for share, expected in ((0.25, True), (0.0, False)):
        asked.clear()
        seek(places, missed, 1, first, Effort(misled, least=40, each=16, beside=share))
        assert np.isin(beside[:1], asked[1]).all() == expected and len(asked[1]) == 16


def test_a_search_by_cross_loss_judges_a_smaller_share_of_more_entries():
    spent = [effort(n).least for n in (400, 4_000, 40_000)]
    assert spent[0] == 250 and spent[0] < spent[1] < spent[2] < 3 * spent[0]

"""Who becomes a parent: tournaments, and a roulette with linear scaling."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.selection import Roulette, Selection, Tournament
from dynreg.search.turns import ranked

EVEN = np.array([4.0, 1.0, 2.0, 3.0, 5.0])  # the best is as far above the mean as the worst is below


def children(selection: Selection, losses: np.ndarray, times: int = 4000) -> np.ndarray:
    """(n,) mean number of children of everyone."""
    rng = stream(0, "children")
    counts = np.zeros(len(losses))
    for _ in range(times):
        parents = selection.parents(losses, ranked(losses, rng)[1], rng)
        counts += np.bincount(parents, minlength=len(losses))
    return counts / times


def test_the_best_has_twice_the_children_of_the_mean_and_the_others_follow_their_losses() -> None:
    assert children(Roulette(), EVEN) == pytest.approx([0.5, 2.0, 1.5, 1.0, 0.0], abs=0.06)


@pytest.mark.parametrize("best", [1.3, 2.0])
def test_neither_the_scale_nor_the_sign_of_losses_matters(best: float) -> None:
    roulette, losses = Roulette(best), np.array([0.0, 0.1, 0.3, 0.35, 0.4])
    expected = roulette.chances(losses)
    assert expected.max() == pytest.approx(best / 5) and expected.sum() == pytest.approx(1.0)
    for scale, shift in ((1e-6, 0.0), (1e6, -3e5), (1.0, 100.0)):
        assert roulette.chances(scale * losses + shift) == pytest.approx(expected, abs=1e-8)


def test_losses_that_are_equal_but_for_a_rounding_have_equal_chances() -> None:
    for many in range(2, 30):
        for loss in (0.1, 0.3, -0.7, 1e-17, 1e9 / 3):
            assert Roulette().chances(np.full(many, loss)) == pytest.approx(1.0 / many)


def test_where_the_worst_would_have_less_than_none_it_has_none_and_the_mean_stays() -> None:
    losses = np.array([0.0, 0.0, 0.0, 0.0, 10.0])
    assert Roulette().chances(losses) == pytest.approx([0.25, 0.25, 0.25, 0.25, 0.0])
    skewed = 5 * Roulette().chances(np.array([0.0, 1.0, 1.0, 1.0, 7.0]))
    assert skewed[-1] == 0.0 and 1.0 < skewed[1] < skewed[0] < 2.0 and skewed.mean() == pytest.approx(1.0)


@pytest.mark.parametrize("selection", [Roulette(), Tournament(12)])
def test_what_has_no_loss_does_not_breed_beside_others(selection: Selection) -> None:
    losses = np.array([np.nan, 3.0, np.nan, 1.0, np.inf])
    counts = children(selection, losses, 200)
    assert counts[3] > counts[1] and counts.sum() == pytest.approx(5.0)
    assert counts[[0, 2, 4]].max() < 0.02 and (not isinstance(selection, Roulette) or not counts[0])


def test_where_nobody_is_better_all_breed_alike() -> None:
    for losses in (np.full(4, np.nan), np.full(4, -2.0)):
        assert children(Roulette(), losses) == pytest.approx(np.ones(4), abs=0.06)
    only = Roulette().chances(np.array([np.nan, 2.0, np.nan]))
    assert only.tolist() == [0.0, 1.0, 0.0]


def test_a_tournament_goes_to_the_best_that_takes_part() -> None:
    # the k-th best of n wins a tournament of t with chance ((n - k + 1)^t - (n - k)^t) / n^t
    expected = 5 * np.diff((np.arange(6) / 5) ** 3)[::-1]
    assert children(Tournament(3), np.arange(5.0)) == pytest.approx(expected, abs=0.06)


def test_parts_that_select_nothing_are_refused() -> None:
    with pytest.raises(UsageError, match="tournament 0"):
        Tournament(0)
    with pytest.raises(UsageError, match="best = 1"):
        Roulette(1.0)

"""The policy gradient: its point goes down by steps of one length, and stays where it should."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.policy import CHANGE, RATE, PolicyGradient

SLOPE = np.array([3.0, -1.0, 0.0, 2.0])


def policy(start: np.ndarray | None = None, **given) -> PolicyGradient:
    return PolicyGradient(np.full(4, 0.5) if start is None else start, rng=stream(0, "policy"), **given)


def test_each_gene_is_lower_the_same_or_higher() -> None:
    away = policy(batch=3000).ask() - 0.5
    shares = [np.isclose(away, sign * CHANGE).mean(axis=0) for sign in (-1, 0, 1)]
    assert np.allclose(shares, 1.0 / 3.0, atol=0.04) and np.allclose(np.sum(shares, axis=0), 1.0)


def test_it_goes_down_the_slope_by_a_step_of_one_length() -> None:
    search = policy(batch=600)
    search.tell(search.ask() @ SLOPE)
    step = search.middle - 0.5
    assert np.linalg.norm(step) == pytest.approx(RATE)
    assert np.array_equal(np.sign(step[SLOPE != 0.0]), -np.sign(SLOPE[SLOPE != 0.0]))
    assert step / RATE == pytest.approx(-SLOPE / np.linalg.norm(SLOPE), abs=0.15)


def test_what_is_best_unchanged_stays() -> None:
    search = policy(batch=600)
    asked = search.ask()
    search.tell(asked[:, 0] + 10.0 * np.abs(asked[:, 1:] - 0.5).sum(axis=1))
    assert search.middle[0] < 0.5 and np.array_equal(search.middle[1:], np.full(3, 0.5))


@pytest.mark.parametrize("losses", [np.zeros(15), np.full(15, np.nan)])
def test_on_flat_ground_and_without_losses_it_stays(losses: np.ndarray) -> None:
    search = policy()
    search.ask()
    search.tell(losses)
    assert np.array_equal(search.middle, np.full(4, 0.5))


def test_a_loss_that_is_no_number_counts_like_the_worst() -> None:
    ends = []
    for bad in (np.nan, np.inf, 1.0):
        search = policy(batch=40)
        losses = search.ask()[:, 0].copy()
        losses[losses > 0.51] = bad
        losses[0], losses[1] = 1.0, 0.2  # the worst that has a loss
        search.tell(losses)
        ends.append(search.middle)
    assert ends[0][0] < 0.5 and all(np.array_equal(ends[0], end) for end in ends)


def test_groups_may_be_empty() -> None:
    """Of two candidates at least one group of every gene is empty; a gene with a lower and a higher one is moved."""
    moved = 0
    for seed in range(40):
        search = PolicyGradient(np.full(4, 0.5), rng=stream(seed, "two"), batch=2)
        asked = search.ask()
        search.tell(asked.sum(axis=1))
        both = np.isclose(np.abs(asked[0] - asked[1]), 2.0 * CHANGE)
        step = search.middle - 0.5
        assert np.isfinite(step).all() and not step[~both].any()
        moved += bool(step[both].any())
    assert moved > 10


def test_it_ends_at_a_bound_and_runs_round_where_a_gene_does() -> None:
    search = policy(np.array([0.01, 0.99, 0.01, 0.99]), periodic=np.array([False, False, True, True]))
    for _ in range(8):
        asked = search.ask()
        assert (asked >= 0.0).all() and (asked <= 1.0).all()
        # down is outward; across the seam it goes on in the same direction
        turned = np.mod(asked[:, 2:] + 0.5, 1.0)
        search.tell(asked[:, 0] - asked[:, 1] + turned[:, 0] - turned[:, 1])
    assert search.middle[:2] == pytest.approx([0.0, 1.0])
    assert 0.7 < search.middle[2] < 0.99 and 0.01 < search.middle[3] < 0.3


@pytest.mark.parametrize("wrong", [{"batch": 1}, {"change": 0.0}, {"rate": -1.0}])
def test_sizes_by_which_nothing_moves_are_refused(wrong: dict) -> None:
    with pytest.raises(UsageError, match="batch"):
        policy(**wrong)

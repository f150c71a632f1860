"""Ties and intervals of held-out errors: what noise hides is a tie, and one run is drawn in stretches of time."""

import numpy as np
import pytest

from dynreg.compare.rollouts import STRETCHES, Errors, _blocks


def errors(each: np.ndarray, noise: tuple[float, ...] = (0.01, 0.5, 0.1)) -> Errors:
    """Of (n, B, C + 1) mean errors of B blocks, each of one sample."""
    every = np.arange(2), np.ones(2, dtype=bool)
    return Errors(1.0, each.shape[1], True, each, np.ones(each.shape[1:]), *every, np.array(noise), None)


def test_without_an_interval_what_noise_or_rounding_hides_is_a_tie_all_the_same() -> None:
    """Two blocks draw no interval; before, nothing was said of any difference then."""
    first = np.array([[0.1, 1.0, 0.3], [0.1, 1.0, 0.3]])
    found = errors(np.stack([first, first + [0.009, 0.6, 0.0]]))
    assert found.bounds(0) is None and found.ratio_to(1) is None
    assert found.tie(0, 1) == (True, None, True)


def test_all_channels_together_tie_below_the_noise_of_all_together() -> None:
    """One channel of many that differs by a little more than its noise does not tell two simulators apart."""
    rng = np.random.default_rng(0)
    first = 1.0 + 0.01 * rng.standard_normal((20, 3))
    found = errors(np.stack([first, first + [0.011, 0.1, 0.06]]))
    assert found.tie(0, 1) == (False, True, True)
    apart = errors(np.stack([first, first + [0.011, 0.1, 0.12]]))
    assert apart.tie(0, 1) == (False, True, False)


@pytest.mark.parametrize("blocks", [4, 8, 12])
def test_nine_of_ten_intervals_hold_the_ratio_and_one_of_ten_equal_simulators_differs(blocks: int) -> None:
    """A bootstrap of four episodes held the truth in 72 %, and told one of two equal simulators apart in 32 %."""
    rng, many = np.random.default_rng(blocks), 400
    held = own = apart = 0
    for _ in range(many):
        each = np.exp(0.5 * rng.standard_normal((2, blocks, 3)))
        found = errors(each, noise=(0.0, 0.0, 0.0))
        low, high = found.ratio_to(1)
        held += low[0] <= 1.0 <= high[0]
        low, high = found.bounds(0)
        own += low[0] <= np.exp(0.5**2 / 2) <= high[0]
        apart += found.tie(0, 1)[0] is False
    assert held / many > 0.82 and own / many > 0.8 and apart / many < 0.18


def test_an_error_of_nothing_has_no_ratio() -> None:
    each = np.ones((2, 5, 3))
    each[0, :, 0] = 0.0
    found = errors(each)
    assert np.isnan(found.ratio_to(1)[:, 0]).all()
    assert found.tie(0, 1) == (False, True, True) and found.bounds(0)[:, 0].tolist() == [0.0, 0.0]


def test_one_run_counts_in_stretches_of_time() -> None:
    """Neighbouring rollouts err alike: an interval over single ones would be far too narrow."""
    rows = np.stack([np.arange(200), np.arange(200) + 1], axis=1)
    blocks, within = _blocks(np.zeros(200, dtype=int), rows[::-1])
    assert within == 1 and len(np.unique(blocks)) == STRETCHES
    assert (np.diff(blocks[::-1]) >= 0).all() and np.bincount(blocks).tolist() == [20] * STRETCHES
    drift = np.sin(np.arange(200) / 30)  # an error that stays alike for long
    total = np.stack([drift + 1.0, np.zeros(200)])[..., None].repeat(3, axis=2)
    wide, narrow = (
        np.ptp(one.bounds(0)[:, 0])
        for one in (
            errors(np.stack([total[:, blocks == b].mean(axis=1) for b in range(STRETCHES)], axis=1)),
            errors(total),
        )
    )
    assert wide > 2 * narrow


@pytest.mark.parametrize(("runs", "within"), [(2, 2), (3, 3), (4, None), (9, None)])
def test_few_runs_count_in_stretches_of_each_and_many_whole(runs: int, within: int | None) -> None:
    episode = np.arange(runs).repeat(30)
    rows = np.tile(np.stack([np.arange(30), np.arange(30) + 1], axis=1), (runs, 1))
    blocks, found = _blocks(episode, rows)
    assert found == within
    assert all(len(np.unique(episode[blocks == b])) == 1 for b in np.unique(blocks)), "no block crosses runs"
    assert len(np.unique(blocks)) == (runs if within is None else STRETCHES)

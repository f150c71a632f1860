"""Ties and intervals of held-out errors: what noise hides is a tie, and one run is drawn in stretches of time."""

import numpy as np
import pytest

from dynreg.compare.rollouts import STRETCHES, Errors, _blocks


def errors(each: np.ndarray, noise: tuple[float, ...] = (0.01, 0.5, 0.1)) -> Errors:
    """Of (n, B, C + 1) mean errors of B blocks, each of one sample."""
    return Errors(
        1.0, each.shape[1], True, each, np.ones(each.shape[1:]), np.arange(2), np.array(noise), None
    )


def test_without_an_interval_what_noise_or_rounding_hides_is_a_tie_all_the_same() -> None:
    """Two blocks draw no interval; before, nothing was said of any difference then."""
    first = np.array([[0.1, 1.0, 0.3], [0.1, 1.0, 0.3]])
    found = errors(np.stack([first, first + [0.009, 0.6, 0.0]]))
    assert found.draws() is None
    assert found.tie(None, 0, 1) == (True, None, True)


def test_all_channels_together_tie_below_the_noise_of_all_together() -> None:
    """One channel of many that differs by a little more than its noise does not tell two simulators apart."""
    rng = np.random.default_rng(0)
    first = 1.0 + 0.01 * rng.standard_normal((20, 3))
    found = errors(np.stack([first, first + [0.011, 0.1, 0.06]]))
    assert found.tie(found.draws(), 0, 1) == (False, True, True)
    apart = errors(np.stack([first, first + [0.011, 0.1, 0.12]]))
    assert apart.tie(apart.draws(), 0, 1) == (False, True, False)


def test_one_run_is_drawn_in_stretches_of_time() -> None:
    """Neighbouring rollouts err alike: an interval over single ones would be far too narrow."""
    rows = np.stack([np.arange(200), np.arange(200) + 1], axis=1)
    blocks, within = _blocks(np.zeros(200, dtype=int), rows[::-1])
    assert within == 1 and len(np.unique(blocks)) == STRETCHES
    assert (np.diff(blocks[::-1]) >= 0).all() and np.bincount(blocks).tolist() == [20] * STRETCHES
    drift = np.sin(np.arange(200) / 30)  # an error that stays alike for long
    total = np.stack([drift + 1.0, np.zeros(200)])[..., None].repeat(3, axis=2)
    wide, narrow = (
        np.ptp(np.quantile(one.draws()[:, 0, 0], (0.05, 0.95)))
        for one in (
            errors(np.stack([total[:, blocks == b].mean(axis=1) for b in range(STRETCHES)], axis=1)),
            errors(total),
        )
    )
    assert wide > 2 * narrow


@pytest.mark.parametrize(("runs", "within"), [(2, 2), (3, 3), (4, None), (9, None)])
def test_few_runs_are_drawn_in_stretches_of_each_and_many_whole(runs: int, within: int | None) -> None:
    episode = np.arange(runs).repeat(30)
    rows = np.tile(np.stack([np.arange(30), np.arange(30) + 1], axis=1), (runs, 1))
    blocks, found = _blocks(episode, rows)
    assert found == within
    assert all(len(np.unique(episode[blocks == b])) == 1 for b in np.unique(blocks)), "no block crosses runs"
    assert len(np.unique(blocks)) == (runs if within is None else runs * -(-STRETCHES // runs))

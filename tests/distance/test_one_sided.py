import numpy as np
import pytest
from planted_family import SHIFTS, family, robot_rows

from dynreg.distance.one_sided import channel_scale, one_sided


@pytest.mark.parametrize("shift", [0.0, 0.42, 1.0])
def test_it_ranks_a_planted_family(shift):
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction)
    x, y = robot_rows(base, direction, shift)
    y = y + 0.05 * np.random.default_rng(0).normal(size=y.shape)
    found = one_sided(entries, base, x, y)
    np.testing.assert_array_equal(np.argsort(found), np.argsort(np.abs(SHIFTS - shift)))


def test_the_base_model_is_at_one_and_a_perfect_entry_at_zero():
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.array([0.0, 1.0]))
    x, y = robot_rows(base, direction, 1.0)
    np.testing.assert_allclose(one_sided(entries, base, x, y), [1.0, 0.0], atol=1e-6)


def test_channels_count_by_what_the_base_misses_not_by_their_size():
    """An entry that halves the small channel's error beats one that takes a tenth off the large one's."""
    small, large = np.array([1.0, 0.0]), np.array([0.0, 30.0])
    base, halves = family(small, np.array([0.5]))
    _, tenth = family(large, np.array([0.1]))
    x, y = robot_rows(base, small + large, 1.0)
    assert one_sided(halves, base, x, y)[0] < one_sided(tenth, base, x, y)[0]
    weights = channel_scale(base, x, y)
    np.testing.assert_allclose(weights @ (small + large), 1.0, rtol=1e-5)


def test_more_models_than_one_batch_give_the_same_numbers():
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.linspace(0, 1, 120))
    x, y = robot_rows(base, direction, 0.3)
    alone = np.concatenate([one_sided(entries[[i]], base, x, y) for i in (0, 49, 50, 119)])
    np.testing.assert_allclose(one_sided(entries, base, x, y)[[0, 49, 50, 119]], alone, rtol=1e-6)

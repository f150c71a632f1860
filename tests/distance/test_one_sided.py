import numpy as np
import pytest
from planted_family import SHIFTS, family, robot_rows

from dynreg.distance.one_sided import channel_scale, one_sided
from dynreg.models.losses import predict
from dynreg.models.normaliser import Normaliser

PLAIN = Normaliser(np.zeros(4), np.ones(4), np.zeros(3), np.ones(3))


@pytest.mark.parametrize("shift", [0.0, 0.42, 1.0])
def test_it_ranks_a_planted_family(shift):
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction)
    x, y = robot_rows(base, direction, shift)
    y = y + 0.05 * np.random.default_rng(0).normal(size=y.shape)
    found = one_sided(entries, base, x[:, None], y[:, None], PLAIN)
    np.testing.assert_array_equal(np.argsort(found), np.argsort(np.abs(SHIFTS - shift)))


def test_the_base_model_is_at_one_and_a_perfect_entry_at_zero():
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.array([0.0, 1.0]))
    x, y = robot_rows(base, direction, 1.0)
    np.testing.assert_allclose(one_sided(entries, base, x[:, None], y[:, None], PLAIN), [1.0, 0.0], atol=1e-6)


def test_channels_count_by_what_the_base_misses_not_by_their_size():
    """An entry that halves the small channel's error beats one that takes a tenth off the large one's."""
    small, large = np.array([1.0, 0.0]), np.array([0.0, 30.0])
    plain = Normaliser(np.zeros(4), np.ones(4), np.zeros(2), np.ones(2))
    base, halves = family(small, np.array([0.5]))
    _, tenth = family(large, np.array([0.1]))
    x, y = robot_rows(base, small + large, 1.0)
    assert (
        one_sided(halves, base, x[:, None], y[:, None], plain)[0]
        < one_sided(tenth, base, x[:, None], y[:, None], plain)[0]
    )
    weights = channel_scale(base, x[:, None], y[:, None], plain)
    np.testing.assert_allclose(weights @ (small + large), 1.0, rtol=1e-5)


def test_more_models_than_one_batch_give_the_same_numbers():
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.linspace(0, 1, 120))
    x, y = robot_rows(base, direction, 0.3)
    alone = np.concatenate(
        [one_sided(entries[[i]], base, x[:, None], y[:, None], PLAIN) for i in (0, 49, 50, 119)]
    )
    np.testing.assert_allclose(
        one_sided(entries, base, x[:, None], y[:, None], PLAIN)[[0, 49, 50, 119]], alone, rtol=1e-6
    )


@pytest.mark.parametrize("steps", [2, 3])
def test_some_steps_ahead_the_model_runs_on_its_own_prediction(steps):
    """A sequence that one entry itself made is predicted by it without error, whatever the normaliser."""
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.array([0.0, 0.4, 1.0]))
    rng = np.random.default_rng(1)
    plain = Normaliser(
        rng.normal(size=4), rng.uniform(0.5, 2, 4), 0.1 * rng.normal(size=3), rng.uniform(0.1, 1, 3)
    )
    states, actions = rng.normal(size=(60, 3)), rng.normal(size=(60, steps, 1))
    inputs, targets = [], []
    for step in range(steps):
        x = plain.inputs(states, actions[:, step], np.zeros((60, 0)))
        y = predict(entries[[1]], x)[0]
        inputs.append(x)
        targets.append(y)
        states = plain.next_states(states, y)
    found = one_sided(entries, base, np.stack(inputs, 1), np.stack(targets, 1), plain)
    assert found[1] < 1e-4
    assert found[0] > 0.5 and found[2] > 0.5


def test_a_model_that_predicts_no_number_is_infinitely_far_and_the_others_are_not():
    direction = np.array([1.0, -0.5, 0.2])
    base, entries = family(direction, np.array([0.0, np.nan, 1.0]))
    x, y = robot_rows(base, direction, 1.0)
    found = one_sided(entries, base, x[:, None], y[:, None], PLAIN)
    np.testing.assert_array_equal(np.isinf(found), [False, True, False])

import numpy as np
import pytest

from dynreg.data.transitions import Transitions
from dynreg.distance.rows import bank_rows, recording_rows, thin
from dynreg.models.normaliser import fit_normaliser
from dynreg.rng import stream

EPISODES, STEPS = 10, 6


@pytest.fixture(scope="module")
def bank():
    """States (M, E, T+1, S) that tell their episode, actions, context, and a normaliser for them."""
    rng = stream(0, "rows of a bank")
    states = rng.normal(size=(3, EPISODES, STEPS + 1, 2)).astype(np.float32)
    actions, context = rng.normal(size=(EPISODES, STEPS, 1)), rng.normal(size=(EPISODES, STEPS, 2))
    spread = [np.broadcast_to(a, (3, *a.shape)).reshape(-1, a.shape[-1]) for a in (actions, context)]
    flat = states[:, :, :-1].reshape(-1, 2), states[:, :, 1:].reshape(-1, 2)
    return states, actions, context, fit_normaliser(flat[0], *spread, flat[1])


def recorded(states, actions, context, episodes: int, rows: int) -> Transitions:
    number = np.repeat(np.arange(episodes), rows)
    now, after = (s.reshape(-1, 2)[: len(number)] for s in (states[0, :, :-1], states[0, :, 1:]))
    a, c = (x.reshape(-1, x.shape[-1])[: len(number)] for x in (actions, context))
    return Transitions(now, a, c, after, number)


def test_rows_of_a_bank_are_those_of_each_entry_alone(bank):
    states, actions, context, normaliser = bank
    rows = bank_rows(states, actions, context, normaliser)
    assert rows.inputs.shape[:2] == rows.targets.shape[:2] == (3, EPISODES * STEPS)
    expected = normaliser.inputs(states[1, 4, :-1], actions[4], context[4])
    np.testing.assert_array_equal(rows.inputs[1, 4 * STEPS : 5 * STEPS], expected)
    expected = normaliser.targets(states[1, 4, :-1], states[1, 4, 1:])
    np.testing.assert_array_equal(rows.targets[1, 4 * STEPS : 5 * STEPS], expected)


def test_a_bank_is_held_out_by_episode(bank):
    held = bank_rows(*bank).held_out.reshape(EPISODES, STEPS)
    assert (held == held[:, :1]).all(), "an episode is held out as a whole or not at all"
    np.testing.assert_array_equal(np.flatnonzero(held[:, 0]), [4, 9])


def test_a_recording_is_held_out_by_episode(bank):
    *data, normaliser = bank
    rows = recording_rows(recorded(*data, EPISODES, STEPS), normaliser)
    held = rows.held_out.reshape(EPISODES, STEPS)
    assert (held == held[:, :1]).all() and 0 < held[:, 0].sum() < EPISODES


def test_a_single_run_is_held_out_by_blocks(bank):
    *data, normaliser = bank
    rows = recording_rows(recorded(*data, 1, EPISODES * STEPS), normaliser)
    assert np.abs(np.diff(rows.held_out.astype(int))).sum() <= 4, "a few long blocks"
    assert 0.1 < rows.held_out.mean() < 0.3


def test_train_and_held_part_all_rows(bank):
    rows = bank_rows(*bank)
    (x, y), (held_x, held_y) = rows.train, rows.held
    assert x.shape[1] + held_x.shape[1] == y.shape[1] + held_y.shape[1] == EPISODES * STEPS


def test_thin_draws_once_and_in_order():
    np.testing.assert_array_equal(thin(7, 10, 0, "any"), np.arange(7))
    few = thin(1000, 64, 0, "any")
    assert len(set(few)) == 64 and (np.diff(few) > 0).all() and few.max() < 1000
    np.testing.assert_array_equal(few, thin(1000, 64, 0, "any"))
    assert not np.array_equal(few, thin(1000, 64, 0, "other"))

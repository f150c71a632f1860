"""The trajectory distance: runs of the same commands are found, whole, shorter, or on the way."""

import numpy as np
import pytest

from dynreg.distance.trajectory import trajectory
from dynreg.errors import LogError, UsageError
from dynreg.rng import stream

ENTRIES, EPISODES, STEPS = 5, 4, 30


@pytest.fixture(scope="module")
def bank():
    """States of entries under a bank of commands, and the commands."""
    rng = stream(0, "bank")
    return rng.normal(size=(ENTRIES, EPISODES, STEPS + 1, 2)), rng.normal(size=(EPISODES, STEPS, 1))


def named(measured, told):
    return {f"run{i}": pair for i, pair in enumerate(zip(measured, told, strict=True))}


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 1], [2]])
def test_it_finds_the_runs_of_the_same_commands(bank, order):
    states, actions = bank
    spread = np.array([1.0, 10.0])
    found = trajectory(states, actions, named(states[3, order], actions[order]), spread)
    assert found.argmin() == 3 and found[3] == 0.0
    expected = np.abs((states[1] - states[3])[order] / spread).mean()
    np.testing.assert_allclose(found[1], expected)


def test_shorter_runs_and_rows_that_were_not_measured_are_compared_where_they_can_be(bank):
    states, actions = bank
    measured = states[2, :, :11].copy()
    measured[:, 4] = np.nan
    found = trajectory(states, actions, named(measured, actions[:, :10]), np.ones(2))
    assert found.argmin() == 2 and np.isfinite(found).all()


def test_each_episode_counts_at_its_own_length(bank):
    """One short episode cut all others to its length."""
    states, actions = bank
    whole, short = (states[1, 0], actions[0]), (states[1, 1, :3], actions[1, :2])
    found = trajectory(states, actions, {"whole": whole, "short": short}, np.ones(2))
    each = [np.abs(states[4, 0] - states[1, 0]).mean(), np.abs(states[4, 1, :3] - states[1, 1, :3]).mean()]
    assert found[4] == pytest.approx(np.mean(each)) and found[1] == 0.0


def test_a_piece_that_begins_on_the_way_is_found_where_it_was(bank):
    """Where few episodes are parted by windows, the part to fit begins on the way."""
    states, actions = bank
    piece = (states[2, 3, 7:20], actions[3, 7:19])
    found = trajectory(states, actions, {"run3[7:20]": piece}, np.ones(2))
    assert found.argmin() == 2 and found[2] == 0.0


def test_an_episode_in_which_nothing_was_measured_says_nothing(bank):
    """Its NaN made the distances of all entries NaN, and their order that of their numbers."""
    states, actions = bank
    episodes = named(states[3, :2].copy(), actions[:2]) | {"one row": (states[3, 2, :1], actions[2, :0])}
    episodes["run1"] = (np.full_like(states[3, 1], np.nan), actions[1])
    found = trajectory(states, actions, episodes, np.ones(2))
    assert np.isfinite(found).all() and found.argmin() == 3
    with pytest.raises(LogError, match="no episode has two rows and a measured state"):
        trajectory(states, actions, {"run1": episodes["run1"]}, np.ones(2))


def test_other_commands_are_refused(bank):
    states, actions = bank
    with pytest.raises(
        UsageError, match="episode 'run1', whose commands the population's simulators did not run"
    ):
        told = np.stack([actions[0], actions[1] + 0.1])
        trajectory(states, actions, named(states[0, :2], told), np.ones(2))


def test_a_held_command_is_compared_where_the_robot_was_most_like(bank):
    """It stands in many rows of a run: the first of them was taken."""
    states, _ = bank
    held = np.zeros((EPISODES, STEPS, 1))
    held[1:] = np.arange(1, EPISODES)[:, None, None]
    piece = (states[2, 0, 20:26], held[0, 20:25])
    found = trajectory(states, held, {"run0[20:26]": piece}, np.ones(2))
    assert found.argmin() == 2 and found[2] == 0.0

import numpy as np
import pytest

from dynreg.distance.trajectory import trajectory
from dynreg.errors import UsageError
from dynreg.rng import stream

ENTRIES, EPISODES, STEPS = 5, 4, 30


@pytest.fixture(scope="module")
def bank():
    """States of entries under a bank of commands, and the commands."""
    rng = stream(0, "bank")
    return rng.normal(size=(ENTRIES, EPISODES, STEPS + 1, 2)), rng.normal(size=(EPISODES, STEPS, 1))


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 1], [2]])
def test_it_finds_the_runs_of_the_same_commands(bank, order):
    states, actions = bank
    spread = np.array([1.0, 10.0])
    found = trajectory(states, actions, states[3, order], actions[order], spread)
    assert found.argmin() == 3 and found[3] == 0.0
    expected = np.abs((states[1] - states[3])[order] / spread).mean()
    np.testing.assert_allclose(found[1], expected)


def test_shorter_runs_and_rows_that_were_not_measured_are_compared_where_they_can_be(bank):
    states, actions = bank
    measured = states[2, :, :11].copy()
    measured[:, 4] = np.nan
    found = trajectory(states, actions, measured, actions[:, :10], np.ones(2))
    assert found.argmin() == 2 and np.isfinite(found).all()


def test_other_commands_are_refused(bank):
    states, actions = bank
    with pytest.raises(
        UsageError, match="episode 1 of the recording ran commands that the population did not"
    ):
        trajectory(states, actions, states[0, :2], np.stack([actions[0], actions[1] + 0.1]), np.ones(2))

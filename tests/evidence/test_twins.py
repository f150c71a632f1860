"""Twins of a simulator move as it does, up to noise, and are the same each time."""

import numpy as np
import pytest

from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.evidence.twins import twins
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.robot import load_robot


@pytest.fixture(scope="module")
def case():
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (), None, 4)
    found = data(robot, log_of(robot, hidden, protocol(robot, seed=4, seconds=15.0)))
    return robot, found.windows, hidden.parameters


def test_a_robot_errs_as_its_twins_do(case):
    """The log of a hidden robot with the twins' physics is one twin more."""
    robot, windows, values = case
    every = np.arange(len(windows))
    replayer = Replayer(robot, windows, 1)
    states = replayer.states(values[None], every)
    made = run(twins(robot, windows, np.repeat(values[None], 12, axis=0), 1))
    left = np.log([errors(replayer.against(states, one)).mean() for one in made])
    log = np.log(errors(replayer.against(states, windows.measured)).mean())
    assert abs(log - left.mean()) < 3 * left.std(ddof=1)
    assert left.std(ddof=1) < 0.3


def test_twins_are_measured_where_the_log_is_and_differ(case):
    robot, windows, values = case
    windows.measured[0, 5:9] = np.nan
    made = run(twins(robot, windows, np.repeat(values[None], 2, axis=0), 1))
    np.testing.assert_array_equal(np.isfinite(made[0]), np.isfinite(windows.measured))
    assert np.nanmax(np.abs(made[0] - made[1])) > 0


def test_twins_depend_on_their_seed_and_number_alone(case):
    robot, windows, values = case
    several = run(twins(robot, windows, np.repeat(values[None], 3, axis=0), 1), threads=2)
    one = run(twins(robot, windows, values[None], 1))
    np.testing.assert_array_equal(several[:1], one)
    assert not np.array_equal(one, run(twins(robot, windows, values[None], 2)), equal_nan=True)

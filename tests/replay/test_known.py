"""What a log tells of parameters: its command rate, where a parameter sets it."""

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.replay.known import command_rate, known_values, nominal_known
from dynreg.sim.robot import load_robot


def test_the_command_rate_is_known_where_a_parameter_sets_it():
    robot = load_robot("quadruped")
    (at,) = np.flatnonzero(~np.isnan(nominal_known(robot)))
    log = Recording((Channel("a", "1"),), (Episode("e", np.arange(20) / 47.0, np.zeros((20, 1))),))
    known = known_values(robot, log)
    assert known[at] == pytest.approx(47.0) and np.isnan(np.delete(known, at)).all()
    assert nominal_known(robot)[at] == robot.space.nominal[at]
    assert command_rate(robot, known) == pytest.approx(47.0)
    assert command_rate(robot, np.full(len(known), np.nan)) == robot.rate


def test_other_robots_tell_nothing():
    robot = load_robot("servo_pendulum")
    assert np.isnan(nominal_known(robot)).all() and command_rate(robot, nominal_known(robot)) == robot.rate

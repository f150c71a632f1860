"""Worn wheels: the lag of the unicycle, what a wheel gives, and that it coasts where it is told less than before."""

import numpy as np
import pytest

from dynreg.timed.commands import Commands
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import KHEPERA, unicycle
from dynreg.timed.worn import STEP, WornWheels

TRACK = 0.0884


def told(
    left: float, right: float, left_before: float, right_before: float, seconds: float = 0.5
) -> Commands:
    return Commands(*(np.array([x]) for x in (left, right, seconds, left_before, right_before)))


def test_wheels_that_give_all_are_the_unicycle() -> None:
    command = told(0.1, 0.14, 0.06, 0.12)
    found = WornWheels(1.0, 1.0).moved(command, TRACK)
    assert found == pytest.approx(unicycle(command, KHEPERA, TRACK, step=STEP), abs=1e-12)
    assert found == pytest.approx(unicycle(command, KHEPERA, TRACK, step=0.001), abs=1e-4)


def test_a_worn_wheel_gives_less_where_it_is_told_as_fast_as_before_or_faster() -> None:
    no_lag = (0.02, 0.02, 0.0, 1.0, 0.0, 1.0)
    wheels, steady = WornWheels(0.7, 1.0, no_lag), told(0.1, 0.1, 0.1, 0.1)
    assert wheels.moved(steady, TRACK)[0] == pytest.approx(
        kinematic(told(0.07, 0.1, 0.07, 0.1), TRACK)[0], abs=1e-3
    )
    up, down = (
        wheels.moved(told(0.1, 0.1, 0.09, 0.1), TRACK)[0],
        wheels.moved(told(0.1, 0.1, 0.11, 0.1), TRACK)[0],
    )
    assert abs(down[2]) < 0.15 * abs(up[2]) and down[1] > up[1] + 0.005
    right = WornWheels(1.0, 0.7, no_lag).moved(steady, TRACK)[0]
    assert right[2] == pytest.approx(-wheels.moved(steady, TRACK)[0, 2], rel=1e-6)


def test_a_command_begins_with_the_speed_of_the_one_before() -> None:
    wheels = WornWheels(0.8, 0.8)
    slow, fast = (wheels.moved(told(0.1, 0.1, b, b), TRACK)[0, 1] for b in (0.0, 0.1))
    lost = 0.08 * 0.087  # m: the speed that is missing at first, for the time of the lag
    assert fast - slow == pytest.approx(lost, rel=0.05)

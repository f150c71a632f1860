"""The reference: commands one after the other, and gains and lags out of a log."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.commands import Commands, chained, drawn
from dynreg.timed.kinematic import kinematic
from dynreg.timed.patterns import PATTERNS
from dynreg.timed.reference import Reference, fitted, on_the_way
from dynreg.timed.unicycle import KHEPERA

TRACK = 0.0884
PLAIN = Reference(KHEPERA, TRACK)


def test_a_command_in_pieces_goes_as_far_as_in_one() -> None:
    """From another command's speeds, which a lag carries over: the last piece begins with what is left of them."""
    whole = Commands(*(np.array([x]) for x in (0.2, -0.1, 0.3, -0.1, 0.15)))
    third = np.full(3, 0.1)
    before = np.array([-0.1, 0.2, 0.2]), np.array([0.15, -0.1, -0.1])
    cut = Commands(np.full(3, 0.2), np.full(3, -0.1), third, *before)
    there = chained(PLAIN.predict(whole))[-1]
    assert chained(PLAIN.predict(on_the_way(cut, np.zeros(3, dtype=int), PLAIN)))[-1] == pytest.approx(
        there, abs=1e-5
    )
    assert np.abs(chained(PLAIN.predict(cut))[-1] - there).max() > 0.01


def test_what_does_not_follow_begins_with_what_was_told() -> None:
    """At another episode, and after a command that is missing; each column stays as it was else."""
    commands = drawn(4, stream(1, "on the way"))
    moved_on = Commands(*commands.columns[:3], *(np.array([0.0, 0.1, 0.1, 0.1]) for _ in range(2)))
    for given, episode in ((commands, np.arange(4)), (moved_on, np.zeros(4, dtype=int))):
        found = on_the_way(given, episode, PLAIN)
        assert found.table == pytest.approx(given.table, abs=1e-12)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_gains_and_lags_come_out_of_a_log(pattern: str) -> None:
    rng = stream(2, "fitted")
    truth = Reference(KHEPERA * [1.5, 0.8, 1, 1, 1, 1], TRACK, left=0.97).changed(pattern, 0.85)
    commands = drawn(600, rng, seconds=(0.4, 0.6))
    moved = truth.predict(commands) + [0.001, 0.001, 0.01] * rng.standard_normal((600, 3))
    moved[::50] += 0.3  # the tracker lost it
    found = fitted(PLAIN, commands, moved, rng)
    assert (found.left, found.right, found.turns) == pytest.approx(
        (truth.left, truth.right, truth.turns), rel=0.01
    )
    assert found.parameters[:2] == pytest.approx(truth.parameters[:2], rel=0.05)


def test_what_the_commands_say_nothing_of_stays_nominal() -> None:
    """Wheels that keep their speeds tell next to nothing of the lags, and the tracker's noise would say anything."""
    rng = stream(3, "steady")
    left, right = rng.uniform(-0.2, 0.2, (2, 60))
    plain = Reference(KHEPERA * [1, 1, 1, 1 / 0.989, 1, 1 / 0.989], TRACK)
    steady = Commands(left, right, np.full(60, 0.5), left, right)
    moved = replace(plain, left=0.9).predict(steady) + [0.001, 0.001, 0.01] * rng.standard_normal((60, 3))
    found = fitted(plain, steady, moved, rng)
    assert (found.left, found.right, found.turns) == pytest.approx((0.9, 1.0, 1.0), rel=0.02)
    assert found.parameters[:2] == pytest.approx(plain.parameters[:2], rel=0.2)


def test_a_robot_without_lags_is_one_with_very_short_ones() -> None:
    commands = drawn(50, stream(4, "no lag"))
    still = Reference(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0]), TRACK).predict(commands)
    assert np.isfinite(still).all()
    assert still[:, 1:] == pytest.approx(kinematic(commands, TRACK)[:, 1:], abs=0.15)

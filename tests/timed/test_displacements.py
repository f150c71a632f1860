"""Displacements of timed commands: the closed form against small steps, one by one against together, poses in a row."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.commands import Commands, chained, drawn, in_a_row, pose_after
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import KHEPERA, LAUT, unicycle

TRACK = 0.0884  # m


@pytest.fixture(scope="module")
def commands() -> Commands:
    return drawn(60, stream(3, "commands"))


def alike(left: float, right: float, seconds: float) -> Commands:
    """One command after itself."""
    one = lambda x: np.array([x])  # noqa: E731
    return Commands(one(left), one(right), one(seconds), one(left), one(right))


def test_commands_follow_each_other_from_standstill_within_their_ranges(commands: Commands) -> None:
    assert np.array_equal(commands.left_before[1:], commands.left[:-1]) and commands.left_before[0] == 0.0
    assert np.array_equal(commands.right_before[1:], commands.right[:-1])
    assert (np.abs(commands.table[:, :4]) <= 0.22).all() and np.ptp(commands.left) > 0.3
    assert (commands.seconds >= 0.1).all() and (commands.seconds <= 2.0).all()
    assert np.array_equal(commands.take(np.arange(5)).table, commands.table[:5])


def test_the_closed_form_drives_lines_arcs_and_turns() -> None:
    ahead = kinematic(alike(0.1, 0.1, 2.0), TRACK)[0]
    assert ahead == pytest.approx([0.0, 0.2, 0.0])
    spot = kinematic(alike(-0.05, 0.05, 1.0), TRACK)[0]
    assert spot == pytest.approx([0.0, 0.0, 0.1 / TRACK])
    # a quarter of a circle to the left about a point 0.3 m to the left: there is 0.3 m ahead and 0.3 m to the left
    turning = 0.5 * np.pi
    quarter = kinematic(alike((0.3 - TRACK / 2) * turning, (0.3 + TRACK / 2) * turning, 1.0), TRACK)[0]
    assert quarter == pytest.approx([-0.3, 0.3, turning])


def test_nearly_straight_is_no_jump() -> None:
    angles = np.array([0.5e-6, 2e-6])  # on both sides of the switch
    two = np.concatenate(
        [kinematic(alike(0.1 - a * TRACK / 2, 0.1 + a * TRACK / 2, 1.0), TRACK) for a in angles]
    )
    assert np.allclose(two, [0.0, 0.1, 0.0], atol=3e-6)


def test_without_lag_the_unicycle_is_the_closed_form(commands: Commands) -> None:
    quick = np.array([0.002, 0.002, 0.0, 1.0, 0.0, 1.0])
    found = unicycle(commands, quick, TRACK, step=0.001)
    late = 0.002 * 0.44  # m: a lag of 2 ms at the largest change of speed
    assert np.abs(found - kinematic(commands, TRACK))[:, :2].max() < 2 * late
    steady = alike(0.08, 0.15, 1.3)  # at speed from the start: no lag shows
    slow = np.array([0.1, 0.2, 0.0, 1.0, 0.0, 1.0])
    assert unicycle(steady, slow, TRACK) == pytest.approx(kinematic(steady, TRACK), rel=1e-6)


def test_the_unicycle_follows_its_equations(commands: Commands) -> None:
    """Speed and yaw rate of a linear lag have a closed form; with couplings finer steps agree."""
    some = commands.take(commands.seconds > 0.5)
    lag = np.array([0.15, 0.05, 0.0, 1.2, 0.0, 0.9])
    told = (some.right - some.left) / TRACK
    before = (some.right_before - some.left_before) / TRACK
    goal, rate = told / 0.9, 0.9 / 0.05
    turned = goal * some.seconds + (before - goal) * (1.0 - np.exp(-rate * some.seconds)) / rate
    assert unicycle(some, lag, TRACK, step=0.002)[:, 2] == pytest.approx(turned, abs=1e-5)
    strong = LAUT * [1.0, 1.0, -300.0, 1.0, 5.0, 1.0]
    assert unicycle(some, strong, TRACK) == pytest.approx(unicycle(some, strong, TRACK, step=0.001), abs=2e-4)
    without = unicycle(some, strong * [1, 1, 0, 1, 0, 1], TRACK)
    assert np.abs(unicycle(some, strong, TRACK) - without).max() > 0.005


def test_candidates_and_commands_do_together_what_they_do_alone(commands: Commands) -> None:
    candidates = np.stack([KHEPERA, LAUT, KHEPERA * 1.1]).reshape(3, 1, 6)
    together = unicycle(commands, candidates, TRACK)
    assert together.shape == (3, 1, 60, 3)
    for i in (0, 17, 59):
        one = commands.take(slice(i, i + 1))
        assert np.array_equal(together[1, 0, i], unicycle(one, LAUT, TRACK)[0])
    tracks = np.array([0.08, TRACK])
    assert np.array_equal(kinematic(commands, tracks)[1], kinematic(commands, TRACK))


def test_steps_too_long_for_a_lag_are_no_number(commands: Commands) -> None:
    with np.errstate(all="raise"):
        assert not np.isfinite(unicycle(commands, KHEPERA * [0.001, 1, 1, 1, 1, 1], TRACK)).all()


def test_displacements_add_up_to_the_way_that_the_wheels_drive() -> None:
    """Two halves of a command are the whole of it."""
    whole = alike(0.1, 0.16, 1.6)
    halves = in_a_row(np.array([0.1, 0.1]), np.array([0.16, 0.16]), np.array([0.8, 0.8]))
    poses = chained(kinematic(halves, TRACK), np.array([1.0, 2.0, 0.4]))
    assert poses.shape == (3, 3) and np.array_equal(poses[0], [1.0, 2.0, 0.4])
    assert poses[-1] == pytest.approx(pose_after(np.array([1.0, 2.0, 0.4]), kinematic(whole, TRACK)[0]))
    assert pose_after(np.array([0.0, 0.0, 0.5 * np.pi]), np.array([0.1, 0.2, 0.3])) == pytest.approx(
        [0.1, 0.2, 0.5 * np.pi + 0.3]
    )

"""Held-out motions beside those that were fitted: what goes further, and what hardly moves, is told."""

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.replay.cut import windows
from dynreg.replay.outside import beyond, reached, small
from dynreg.replay.parts import parts
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.held_out import held_out_notes

SLOW, FAST = 2 * np.pi / 2.5, 8 * np.pi / 2.5  # rad/s: one swing, and four, in an episode


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def swings(*each: tuple[float, float]) -> Recording:
    """Episodes of a servo that swings by (amplitude [rad], rate [rad/s])."""
    names = ("arm/position", "arm/velocity", "arm/target", "supply", "arm/enabled")
    channels = tuple(Channel(n, u) for n, u in zip(names, ("rad", "rad/s", "rad", "V", "1"), strict=True))
    time = 0.01 * np.arange(250)
    episodes = []
    for number, (size, rate) in enumerate(each):
        swing, speed = size * np.sin(rate * time), size * rate * np.cos(rate * time)
        rows = np.stack([swing, speed, swing, 7.4 + 0 * time, 1 + 0 * time], axis=1)
        episodes.append(Episode(f"run{number}", time, rows, {"kp": 400.0, "added_mass": 0.0}))
    return Recording(channels, tuple(episodes))


def notes(robot: Robot, recording: Recording, hold_out: str) -> tuple[str, ...]:
    cut = windows(robot, recording)
    return held_out_notes(robot, cut, parts(recording, cut, hold_out))


def test_a_held_out_run_that_goes_further_or_faster_is_told(robot: Robot) -> None:
    slow = swings((0.5, SLOW), (0.5, SLOW), (0.5, SLOW), (1.0, SLOW), (0.5, FAST))
    (said,) = notes(robot, slow, "run3")
    assert (
        "arm/position reaches 0.999 rad from its middle, 0.5 where it was fitted" in said
        and "--hold-out" in said
    )
    (said,) = notes(robot, slow, "run4")
    assert "speed of arm reaches 5" in said and "arm/position" not in said
    assert notes(robot, slow, "run1") == () == notes(robot, slow, "0")


def test_a_held_out_run_that_hardly_moves_is_told(robot: Robot) -> None:
    recording = swings((0.5, SLOW), (0.5, SLOW), (0.5, SLOW), (0.1, SLOW))
    (said,) = notes(robot, recording, "run3")
    assert "small or slow" in said
    cut = windows(robot, recording)
    found = reached(robot, cut, parts(recording, cut, "run3"))
    assert small(found) and beyond(found) == ()


def test_where_no_speed_has_a_weight_that_of_the_position_counts(robot: Robot) -> None:
    recording = swings((0.5, SLOW), (0.5, SLOW), (0.5, SLOW), (0.5, FAST))
    cut = windows(robot, recording)
    found = beyond(reached(robot, cut, parts(recording, cut, "run3")))
    assert [one.signal for one in found] == ["speed of arm"] and found[0].ratio == pytest.approx(4.0, rel=0.1)

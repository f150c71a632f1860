"""Errors planted in one regime of a hand-made motion are found in that regime."""

from dataclasses import replace

import numpy as np
import pytest
from motions import swing, triangle, windows_of

from dynreg.diagnose.signals import joint_signals
from dynreg.diagnose.where import motion_regimes, split_errors
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.diagnosis_words import finding


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def cut(robot: Robot, measured: np.ndarray, reach: float | np.ndarray = 0.05, **kwargs):
    """Windows of (W, T+1, 2) under commands `reach` rad ahead of the motion."""
    ahead = reach * np.sign(measured[:, :-1, 1:])
    return windows_of(robot, measured, measured[:, :-1, :1] + ahead, **kwargs)


def regimes(robot: Robot, windows) -> dict[str, np.ndarray]:
    return motion_regimes(joint_signals(robot, windows)["arm"], windows.period)


def rows_by_regime(rows, channel="arm/position"):
    return {r.regime: r for r in rows if r.channel == channel}


def with_error(windows, mask: np.ndarray, size: float = 0.1, rest: float = 0.01) -> np.ndarray:
    """(W, T+1, S) states that are `size` off where the mask (W, T) is, `rest` elsewhere."""
    states = windows.measured.copy()
    states[:, 1:, 0] += np.where(mask, size, rest)
    return states


# ---- regimes ----


def test_reversals_are_the_slow_rows_near_a_change_of_direction(robot):
    t = np.arange(200) * 0.01
    velocity = 3.0 * np.cos(2 * np.pi * t)  # zero at rows 25, 75, 125, 175
    measured = np.stack([3.0 * np.sin(2 * np.pi * t) / (2 * np.pi), velocity], axis=1)[None]
    found = regimes(robot, cut(robot, measured))["reversals"][0]
    lively = np.quantile(np.abs(velocity[:-1]), 0.95)
    expected = np.zeros(199, dtype=bool)
    for at in (25, 75, 125, 175):
        expected[max(at - 10, 0) : at + 11] = True
    expected &= np.abs(velocity[:-1]) < 0.25 * lively
    np.testing.assert_array_equal(found, expected)
    assert found.sum() == pytest.approx(4 * 9, abs=2)


def test_a_stop_without_turning_back_is_slow_but_no_reversal(robot):
    velocity = np.concatenate([np.full(50, 2.0), np.zeros(60), np.full(50, 2.0)])
    velocity[50:110] += 0.02 * np.sin(np.arange(60))  # noise of the sensor about zero
    measured = np.stack([np.cumsum(velocity) * 0.01, velocity], axis=1)[None]
    found = regimes(robot, cut(robot, measured))
    assert not found["reversals"].any()
    np.testing.assert_array_equal(np.flatnonzero(found["low_speed"][0]), np.arange(50, 110))


def test_speed_and_load_regimes_are_shares_of_the_samples(robot):
    windows = cut(robot, swing(801)[None])
    signals = joint_signals(robot, windows)["arm"]
    found = regimes(robot, windows)
    assert found["high_speed"].mean() == pytest.approx(0.2, abs=0.01)
    assert found["high_load"].mean() == pytest.approx(0.2, abs=0.01)
    speed = np.abs(signals.velocity)
    assert speed[found["high_speed"]].min() >= speed[~found["high_speed"]].max()
    assert signals.load[found["high_load"]].min() >= signals.load[~found["high_load"]].max()


def test_saturation_and_drive_off_follow_the_commands_and_the_enable_channel(robot):
    measured = np.zeros((1, 61, 2))
    measured[..., 1] = 0.1
    actions = np.full((1, 60, 1), 0.05)
    actions[0, 10:20] = 1.5  # duty clips beyond 1 / (0.002877 * 400) = 0.87 rad
    inputs = np.tile(robot.input_defaults, (1, 60, 1))
    inputs[0, 40:, 1] = 0.0
    actions[0, 50:] = 1.5  # a drive that is off is not at its limit
    found = regimes(robot, windows_of(robot, measured, actions, inputs=inputs))
    np.testing.assert_array_equal(np.flatnonzero(found["saturation"][0]), np.arange(10, 20))
    np.testing.assert_array_equal(np.flatnonzero(found["drive_off"][0]), np.arange(40, 60))
    assert not (found["high_load"] & found["drive_off"]).any() and found["high_load"][0, 10:20].all()


# ---- rows ----


@pytest.mark.parametrize("regime", ["reversals", "high_speed", "high_load"])
def test_an_error_planted_in_a_regime_is_found_there(robot, regime):
    measured = swing(401)[None].repeat(2, axis=0)
    q = measured[:, :-1, 0]
    windows = cut(robot, measured, reach=0.02 + 0.2 * ((q > 0.1) & (q < 0.3))[..., None])
    mask = regimes(robot, windows)[regime]
    rows = split_errors(robot, windows, with_error(windows, mask))
    found = rows_by_regime(rows)[regime]
    assert found.error == pytest.approx(0.1) and found.ratio == pytest.approx(10.0)
    assert found.samples == mask.sum() and found.joint == "arm" and found.unit == "rad"
    many, few = 0.1 * mask.sum(), 0.01 * (~mask).sum()
    assert found.share == pytest.approx(many / (many + few))
    words = {
        "reversals": "where the motion reverses",
        "high_speed": "at high speed",
        "high_load": "under high load",
    }
    assert words[regime] in finding(rows) and f"{100 * found.share:.0f} %" in finding(rows)


def test_shares_are_of_the_weighted_error_and_sum_to_one(robot):
    quadruped = load_robot("quadruped")
    rng = np.random.default_rng(0)
    measured = rng.standard_normal((2, 31, len(quadruped.channels)))
    windows = windows_of(quadruped, measured, rng.standard_normal((2, 30, 12)), period=1 / 36)
    states = measured + 0.1 * rng.standard_normal((3, *measured.shape))
    for one in states:
        rows = split_errors(quadruped, windows, one)
        whole = [r for r in rows if r.regime == "overall"]
        assert len(whole) == len(quadruped.channels)
        assert sum(r.share for r in whole) == pytest.approx(1.0)
        assert all(r.ratio is None for r in whole)
        error = np.abs(one[:, 1:] - measured[:, 1:]).mean(axis=(0, 1))
        np.testing.assert_allclose([r.error for r in whole], error)
    assert all(r.share == 0 for r in rows if r.channel == "fl_hip/velocity")  # no weight
    assert {r.regime for r in rows if r.channel == "base/roll"} <= {"overall", "early", "late", "saturation"}


def test_regimes_without_samples_are_left_out(robot):
    windows = cut(robot, swing(201)[None])
    found = rows_by_regime(split_errors(robot, windows, windows.measured + 0.1))
    assert set(found) == {"overall", "reversals", "low_speed", "high_speed", "high_load", "early", "late"}


def test_time_is_that_of_the_rollout_and_that_of_the_log(robot):
    measured = swing(91)[None].repeat(3, axis=0)
    windows = cut(robot, measured, begin=np.array([0.0, 10.0, 20.0]))
    states = measured[None].repeat(2, axis=0)
    states[0, :, 61:, 0] += 0.1  # drifts in every rollout
    states[1, 2, :, 0] += 0.1  # the end of the log
    drift, worn = (rows_by_regime(split_errors(robot, windows, one)) for one in states)
    assert drift["late"].share == pytest.approx(1.0) and drift["early"].error == 0
    assert drift["log_end"].share == pytest.approx(1 / 3, abs=0.02)
    assert worn["log_end"].share == pytest.approx(1.0) and worn["log_end"].ratio is None  # no error elsewhere
    assert worn["late"].ratio == pytest.approx(1.0)


def test_what_was_not_measured_poisons_nothing(robot):
    whole = cut(robot, swing(401)[None].repeat(3, axis=0))
    mask = regimes(robot, whole)["high_speed"]
    states = with_error(whole, mask)
    measured = whole.measured.copy()
    measured[1, 200:] = np.nan  # a shorter window
    measured[2, 50:60] = np.nan  # a gap
    measured[..., 1] = np.nan  # no velocities
    weight = np.array([1.0, 0.0])
    rows = split_errors(robot, replace(whole, measured=measured, weight=weight), states)
    assert {r.channel for r in rows} == {"arm/position"}
    assert all(np.isfinite([r.error, r.share]).all() for r in rows)
    found = rows_by_regime(rows)
    assert found["overall"].samples == 400 + 199 + 390 and found["overall"].share == pytest.approx(1.0)
    assert found["high_speed"].error == pytest.approx(0.1, rel=0.1)


def test_a_diverged_simulation_counts_as_ten_times_the_motion(robot):
    windows = cut(robot, swing(101)[None])
    states = windows.measured[None].repeat(2, axis=0)
    states[0, :, 50:] = np.nan
    states[1, :, 50:] = 1e30
    late = [rows_by_regime(split_errors(robot, windows, one))["late"].error for one in states]
    np.testing.assert_allclose(late, 10 * windows.spread[0])


# ---- the sentence ----


def test_an_even_error_stands_out_nowhere(robot):
    windows = cut(robot, swing(401)[None])
    said = finding(split_errors(robot, windows, windows.measured + 0.1))
    assert said == "100 % of the error is on arm/position; no regime of its motion stands out."
    assert finding(split_errors(robot, windows, windows.measured)) == "No error was measured."


def test_a_rollout_that_drifts_names_no_place(robot):
    windows = cut(robot, swing(401)[None])
    states = windows.measured.copy()
    states[..., 0] += np.linspace(0, 0.2, 401)
    assert "no regime" in finding(split_errors(robot, windows, states))


def test_a_sharp_triangle_has_no_slow_rows(robot):
    """Nothing divides by a regime that is empty."""
    windows = cut(robot, triangle(201)[None])
    found = rows_by_regime(split_errors(robot, windows, windows.measured + 0.1))
    assert "reversals" not in found and "low_speed" not in found

"""What noise in the measured start states does to residuals is taken out of them, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest
import secret_servo

from dynreg.replay.cut import windows
from dynreg.replay.start_error import believed, noisy_channels, start_slopes
from dynreg.replay.windows import Replayer
from dynreg.sim.robot import load_robot

VALUES = secret_servo.values_of(1)


@pytest.fixture(scope="module")
def replayer() -> Replayer:
    """Of a servo without errors of its model: its windows start from states with noise, as they are measured."""
    robot = load_robot("servo_pendulum")
    recording = secret_servo.record(VALUES, 1, episodes=6, steps=60)
    cut = windows(robot, recording)
    true = Replayer(robot, cut).states(VALUES[None], np.arange(len(cut)))[0]
    rng = np.random.default_rng(3)
    initial = cut.run.initial + robot.sensor_noise * rng.standard_normal(cut.run.initial.shape)
    measured = true + robot.sensor_noise * rng.standard_normal(true.shape)
    return Replayer(robot, replace(cut, run=replace(cut.run, initial=initial), measured=measured))


def rms(residual: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(residual**2)))


def every(replayer: Replayer) -> np.ndarray:
    return np.arange(len(replayer.windows))


def test_noise_of_the_start_is_taken_out_of_the_residuals_of_the_robot_itself(replayer):
    chosen = every(replayer)
    (residual,) = replayer.residuals(VALUES[None], chosen)
    start = start_slopes(replayer, VALUES, chosen, residual).errors(residual)
    noise = rms(replayer.residual_noise)
    assert rms(residual) > 1.5 * noise
    assert rms(start.removed(residual[None])) < 1.1 * noise


def test_what_another_parameter_does_stays_in_the_residuals(replayer):
    """A zero offset of 3 degrees acts on all of a window, its start on the first moments."""
    chosen, other = every(replayer), VALUES.copy()
    other[replayer.robot.space.names.index("zero_offset")] += 0.05
    raw = replayer.residuals(np.stack([VALUES, other]), chosen)
    start = start_slopes(replayer, VALUES, chosen, raw[0]).errors(raw[0])
    before, after = (np.abs(r[1]).mean() for r in (raw, start.removed(raw)))
    assert after > 0.7 * before


def test_far_from_the_robot_the_measured_start_is_believed(replayer):
    """Its residuals are as large as the motion: they tell no error of a millirad."""
    chosen, other = every(replayer), replayer.robot.space.nominal
    (residual,) = replayer.residuals(other[None], chosen)
    slopes = start_slopes(replayer, other, chosen, residual)
    far = slopes.errors(residual)
    change = np.abs(far.removed(residual[None]) - residual).mean()
    assert change < 0.05 * np.abs(residual).mean()


def test_what_was_not_measured_tells_nothing_and_stays_so(replayer):
    chosen = every(replayer)
    (residual,) = replayer.residuals(VALUES[None], chosen)
    slopes = start_slopes(replayer, VALUES, chosen, residual)
    some = residual.copy()
    some[0, 10:], some[1] = np.nan, np.nan
    removed = slopes.errors(some).removed(some[None])[0]
    np.testing.assert_array_equal(np.isnan(removed), np.isnan(some))
    whole = slopes.errors(residual).removed(residual[None])[0]
    assert np.abs(removed[2:] - whole[2:]).max() < 0.2 * np.abs(whole).max()


def test_believed_starts_change_nothing():
    residual = np.random.default_rng(0).normal(size=(4, 20, 3))
    residual[0, 3] = np.nan
    np.testing.assert_array_equal(believed(residual).errors(residual).removed(residual[None])[0], residual)


def test_a_replay_a_channel_that_states_a_noise(replayer):
    chosen = every(replayer)
    (residual,) = replayer.residuals(VALUES[None], chosen)
    before = replayer.rollouts
    slopes = start_slopes(replayer, VALUES, chosen, residual)
    channels = noisy_channels(replayer.robot)
    assert replayer.rollouts - before == len(channels) == slopes.slopes.shape[2] > 0
    assert slopes.slopes.shape[:2] == (len(chosen), residual[0].size)


def test_a_robot_whose_channels_state_no_noise_is_believed(replayer):
    file = replayer.robot.file
    sure = [c.model_copy(update={"noise": 0.0, "quantum": 0.0}) for c in file.channels]
    robot = replace(replayer.robot, file=file.model_copy(update={"channels": sure}))
    exact = Replayer(robot, replayer.windows)
    chosen = every(exact)
    (residual,) = exact.residuals(VALUES[None], chosen)
    start = start_slopes(exact, VALUES, chosen, residual).errors(residual)
    np.testing.assert_array_equal(start.removed(residual[None])[0], residual)
    assert exact.rollouts == 1 and (start.fitted == 0).all()


def test_residuals_that_are_smaller_than_the_noise_do_not_free_the_start(replayer):
    """Three rows, or an offset in all of them: the noise that the robot states holds the start back."""
    chosen = every(replayer)
    (residual,) = replayer.residuals(VALUES[None], chosen)
    slopes = start_slopes(replayer, VALUES, chosen, residual)
    few = np.full_like(residual, np.nan)
    few[:, :2] = 100 * replayer.residual_noise
    assert rms(slopes.errors(few).removed(few[None])) > 0.9 * rms(few)
    offset = np.full_like(residual, 100 * replayer.residual_noise[0])
    assert rms(slopes.errors(offset).removed(offset[None])) > 0.5 * rms(offset)
    nothing = np.zeros_like(residual)
    start = slopes.errors(nothing)
    assert np.isfinite(start.covariance).all() and (start.removed(nothing[None]) == 0).all()

"""The residual: in units of the motion, bounded, nothing where nothing was measured."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from by_hand import held_against_zero

from dynreg.compare.rollouts import _errors
from dynreg.replay.residual import MOST, by_weight, scaled
from dynreg.replay.windows import Replayer, errors


def test_residuals_are_bounded_and_the_lost_ones_count_most():
    simulated = np.array([[1.0, 2.0], [np.nan, 1e9], [-np.inf, -1e9], [3.0, np.nan]])
    measured = np.array([[0.5, 2.5], [0.0, 0.0], [0.0, 0.0], [np.nan, np.nan]])
    found = scaled(simulated, measured, np.array([0.5, 2.0]))
    assert np.array_equal(found[:3], [[1.0, -0.25], [MOST, MOST], [MOST, -MOST]])
    assert np.isnan(found[3]).all()


def test_a_correction_counts_in_units_of_the_motion():
    simulated, measured, spread = np.ones((2, 3, 1)), np.zeros((3, 1)), np.array([0.5])
    assert (scaled(simulated, measured, spread, np.full((2, 3, 1), -2.0)) == 0.0).all()


def test_every_measured_value_counts_by_the_weight_of_its_channel():
    measured = np.zeros((1, 4, 3))
    measured[0, 1:, 1] = np.nan
    share = by_weight(measured, np.array([0.2, 0.8, 0.0]))
    assert share == pytest.approx(np.array([[0.2, 0.8, 0.0]]) * 5 / (4 * 0.2 + 0.8))


def test_a_query_a_diagnosis_and_a_comparison_have_one_error_of_all_channels():
    """A slow sensor of three times the weight: they had three, 0.62, 1.75 and 1.13."""
    _, data = held_against_zero("resistance", windows=2, rows=20)
    measured, states = data.windows.measured.copy(), np.zeros((1, 2, 21, 2))
    measured[:, 2:, 1] = np.nan  # two samples of it, the start among them
    states[..., 0], states[..., 1] = 1.0, 2.0
    cut = replace(data.windows, measured=measured, weight=np.array([0.25, 0.75]))
    robot = SimpleNamespace(sensor_noise=np.zeros(2))
    every, expected = np.arange(2), (20 * 0.25 + 0.75 * 2.0) / (20 * 0.25 + 0.75)
    assert errors(Replayer(robot, cut).against(states, measured)) == pytest.approx(expected)
    assert replace(data, windows=cut).window_errors(states[0], every) == pytest.approx(expected)
    compared = _errors(robot, cut, every, states, 0.2, True)
    assert compared.mean[0] == pytest.approx([1.0, 2.0, expected])

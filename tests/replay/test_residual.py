"""The residual: in units of the motion, bounded, nothing where nothing was measured."""

import numpy as np

from dynreg.replay.residual import MOST, scaled


def test_residuals_are_bounded_and_the_lost_ones_count_most():
    simulated = np.array([[1.0, 2.0], [np.nan, 1e9], [-np.inf, -1e9], [3.0, np.nan]])
    measured = np.array([[0.5, 2.5], [0.0, 0.0], [0.0, 0.0], [np.nan, np.nan]])
    found = scaled(simulated, measured, np.array([0.5, 2.0]))
    assert np.array_equal(found[:3], [[1.0, -0.25], [MOST, MOST], [MOST, -MOST]])
    assert np.isnan(found[3]).all()


def test_a_correction_counts_in_units_of_the_motion():
    simulated, measured, spread = np.ones((2, 3, 1)), np.zeros((3, 1)), np.array([0.5])
    assert (scaled(simulated, measured, spread, np.full((2, 3, 1), -2.0)) == 0.0).all()

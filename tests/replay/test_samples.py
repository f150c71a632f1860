"""Independent samples of residuals: known series hold as many as their theory says."""

import numpy as np
import pytest

from dynreg.replay.samples import correlation_time, effective_samples, samples_in_all
from dynreg.rng import stream


def ar(phi: float, shape: tuple[int, ...]) -> np.ndarray:
    """AR(1) series along the last axis, stationary from the start."""
    x = np.random.default_rng(0).standard_normal(shape)
    x[..., 0] /= np.sqrt(1 - phi**2)
    for t in range(1, shape[-1]):
        x[..., t] += phi * x[..., t - 1]
    return x


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.97])
def test_the_correlation_time_of_ar1_is_that_of_its_theory(phi):
    time = (1 + phi) / (1 - phi)
    assert correlation_time(ar(phi, (200_000,))) == pytest.approx(time, rel=0.1)
    many = effective_samples(ar(phi, (20, 10_000))[..., None])
    assert many.sum() == pytest.approx(200_000 / time, rel=0.15)


def test_an_alternating_series_counts_no_more_samples_than_it_has():
    assert correlation_time(ar(-0.8, (5000,))) == pytest.approx(1.0)


def test_samples_in_all_are_the_independent_ones():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(3, 2000, 1))
    assert samples_in_all(white) == pytest.approx(6000, rel=0.1)
    slow = np.zeros_like(white)
    for t in range(1, 2000):
        slow[:, t] = 0.9 * slow[:, t - 1] + white[:, t]
    assert samples_in_all(slow) == pytest.approx(6000 * 0.1 / 1.9, rel=0.4)
    holed = white.copy()
    holed[:, ::2] = np.nan
    assert samples_in_all(holed) == pytest.approx(3000, rel=0.15)
    assert samples_in_all(np.zeros((2, 50, 1))) == 1.0


def test_a_window_that_drifts_counts_for_less_where_windows_stand_apart():
    noise = stream(0, "drift").standard_normal((5, 200, 1))
    noise[0] = np.cumsum(noise[0], axis=0)
    usual, apart = effective_samples(noise), effective_samples(noise, apart=True)
    assert apart[0, 0] < 0.1 * usual[0, 0]
    assert (apart <= usual).all() and apart[1:].sum() > 0.8 * usual[1:].sum()

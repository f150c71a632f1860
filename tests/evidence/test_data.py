"""Windows in segments: each part of a rollout counts with a variance of its own, and shares the rollout's samples."""

from dataclasses import replace

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain

from dynreg.evidence.data import BEFORE, Sample
from dynreg.evidence.likelihood import objective

ROWS, SEGMENTS = 41, 2  # which do not go into it


@pytest.fixture(scope="module")
def noisy() -> tuple[Sample, Sample, np.ndarray, np.ndarray]:
    """A sample in segments and the same whole; residuals (W, T, C) of both."""
    model, data = held_against_zero("resistance", rows=ROWS, segments=SEGMENTS)
    noise = np.random.default_rng(0).standard_normal((1, 2, ROWS)).cumsum(axis=2)
    samples = [one.sample(one.fit) for one in (data, data.whole)]
    cut, whole = (
        answered(model.residuals([plain(0.0)], sample), lambda a: first_channel(a, noise))[0]
        for sample in samples
    )
    return *samples, cut, whole


def test_segments_hold_all_of_a_rollout(noisy):
    sample, uncut, cut, whole = noisy
    assert uncut.data.whole is uncut.data
    joined = cut.reshape(len(sample.chosen), -1, cut.shape[-1])
    assert cut.shape[0] == SEGMENTS * len(sample.chosen) == SEGMENTS * whole.shape[0]
    assert np.array_equal(joined[:, :ROWS], whole)
    assert np.isnan(joined[:, ROWS:]).all() and joined.shape[1] < ROWS + SEGMENTS


def test_segments_share_the_samples_of_their_rollout_by_what_was_measured(noisy):
    sample, uncut, cut, whole = noisy
    early, known = cut.copy(), whole.copy()
    early[1::SEGMENTS], known[:, cut.shape[1] :] = np.nan, np.nan  # measured at first alone
    for one, other in ((cut, whole), (early, known)):
        shared = sample.reweighted(one).effective
        assert shared.reshape(len(whole), SEGMENTS, -1).sum(axis=1) == pytest.approx(
            uncut.reweighted(other).effective
        )
    assert (shared[1::SEGMENTS] == 0).all() and (shared[::SEGMENTS] > 0).all()


def test_before_anything_is_known_every_rollout_has_as_many_samples(noisy):
    for sample in noisy[:2]:
        assert sample.effective.sum(axis=0) == pytest.approx(BEFORE * len(sample.chosen))
        few = sample.take(1)
        assert len(few.chosen) == 1 and few.effective.sum() == pytest.approx(BEFORE)


def test_what_comes_after_a_slip_does_not_drown_what_came_before():
    """One simulator is right until the slip, the other wrong all along, and a little less so after it."""
    model, data = held_against_zero("resistance", windows=1, fits=1, segments=SEGMENTS)
    slipped, wrong = np.full(40, 0.02), np.full(40, 0.2)
    slipped[20:], wrong[20:] = 1.0, 0.9
    costs = []
    for one in (data, data.whole):
        sample = replace(one.sample(one.fit), effective=np.full((one.segments, 1), 10.0))
        answer = lambda a: first_channel(a, np.stack([slipped, wrong])[:, None])  # noqa: E731
        residuals = answered(model.residuals([plain(0.0)] * 2, sample), answer)
        costs.append(objective([plain(0.0)] * 2, residuals, sample))
    assert costs[0][0] < costs[0][1] and costs[1][0] > costs[1][1]


def test_errors_of_windows_are_weighted_and_leave_out_what_was_not_measured():
    _, data = held_against_zero("resistance")
    windows = replace(data.windows, measured=data.windows.measured.copy(), spread=2.0 * data.windows.spread)
    windows.measured[1, 5:, 0] = np.nan
    states = np.zeros((2, 41, len(windows.weight)))
    states[0, 1:, 0], states[1, :5, 0], states[:, :, 1] = 0.5, 3.0, 99.0  # the second channel has no weight
    errors = replace(data, windows=windows).window_errors(states, data.fit)
    assert errors == pytest.approx([0.25, 1.5])

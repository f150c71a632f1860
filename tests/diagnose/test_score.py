"""Scores: gains count as far as they are confirmed, by the residual that has fewer samples; fewer parameters win."""

from dataclasses import replace

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, keys_of, plain, with_effect

from dynreg.diagnose.score import (
    BEYOND,
    FEW,
    NEAR,
    PER_PARAMETER,
    Scored,
    by_either,
    chosen,
    confirmed,
    passing,
    score,
)
from dynreg.evidence.likelihood import log_likelihood, mean_squares
from dynreg.evidence.lockstep import Ask

NOISE = np.random.default_rng(0).standard_normal((3, 60))
PAYLOAD = with_effect("payload", 0.0)


def nats(segments: int, gained, where: slice) -> float:
    """Of a payload that takes nine tenths of the error in some of three windows, two to fit and one to select by."""
    model, data = held_against_zero("resistance", rows=60, segments=segments)

    def answer(one: Ask) -> np.ndarray:
        rows = np.tile(NOISE, (len(keys_of(one)), 1, 1))
        for i, key in enumerate(keys_of(one)):
            if key:
                rows[i, where] *= 0.1
        return first_channel(one, rows)

    naming = answered(score(model, data, plain(0.0), [PAYLOAD], gained), answer)
    return naming.ranking[0].nats


@pytest.mark.parametrize("segments", [1, 3])
def test_what_a_cause_gains_on_fit_alone_counts_no_more_than_a_little(segments: int):
    assert nats(segments, confirmed, slice(0, 2)) == pytest.approx(BEYOND - PER_PARAMETER)
    both = nats(segments, confirmed, slice(0, 3))
    assert both > 50 and both == pytest.approx(nats(segments, by_either, slice(0, 3)), rel=1e-6)


def test_fitted_on_all_windows_together_what_a_cause_gains_counts_wherever_it_does():
    assert nats(3, by_either, slice(0, 2)) > 50 and nats(3, by_either, slice(2, 3)) > 20


@pytest.mark.parametrize("slow", [0, 1], ids=["of the plain model", "of the term"])
def test_a_gain_is_counted_by_the_samples_of_the_residual_that_has_fewer(slow: int):
    """Where one of two residuals stays alike for long in the window that is explained, that one counts."""
    data = replace(held_against_zero("resistance", rows=400)[1], apart=True)
    rng = np.random.default_rng(1)
    residuals = rng.standard_normal((2, 3, 400, 1))
    residuals[slow, 0] = np.sin(np.linspace(0.0, 12.0, 400))[:, None]
    residuals[1, 0] *= 0.1
    squares = mean_squares(residuals, data.floor)
    counted = [float(np.diff(log_likelihood(squares, data.effective(r)))[0]) for r in residuals]
    assert max(counted) > 3.0 * min(counted) > 0.0
    assert by_either(data, residuals) == pytest.approx([0.0, min(counted)])


def test_among_equals_the_one_with_fewer_parameters_is_chosen():
    plain_, rich = with_effect("load_friction", 0.0), with_effect("stribeck_load_friction", 0.0)
    start, top = Scored(plain(0.0), 0.0), 200.0
    near = chosen(start, [Scored(rich, top), Scored(plain_, top - NEAR * top + 0.1)])
    assert near.chosen.key == "load_friction" and [s.key for s in near.equivalent] == [
        "stribeck_load_friction"
    ]
    assert (
        chosen(start, [Scored(rich, top), Scored(plain_, top - 2 * NEAR * top)]).chosen.key
        == rich.hypothesis.key
    )
    assert chosen(start, [Scored(rich, 20.0), Scored(plain_, 20.0 - FEW + 0.1)]).chosen.key == "load_friction"
    assert chosen(start, [Scored(plain_, -1.0)]).chosen is None and chosen(start, []).chosen is None


def test_what_is_below_half_its_weak_size_is_not_ranked():
    model, data = held_against_zero("resistance", rows=60)
    answer = lambda one: first_channel(one, NOISE)  # noqa: E731
    little = with_effect("payload", 0.0, size=1e-3)
    naming = answered(score(model, data, plain(0.0), [little]), answer)
    assert naming.ranking == () and naming.small == ("payload",)


def test_a_cause_above_the_threshold_gives_no_way_to_a_simpler_one_below_it():
    """Stribeck's 21.5 nats passed 20, Coulomb's 19 were chosen as the simpler, and no cause was named."""
    simple, rich = with_effect("load_friction", 0.0), with_effect("stribeck_load_friction", 0.0)
    naming = chosen(Scored(plain(0.0), 0.0), (Scored(rich, 21.5), Scored(simple, 19.0)))
    assert naming.chosen.key == "load_friction" and naming.most == 21.5, (
        "what a robot without an effect scores"
    )
    found = passing(naming, 20.0)
    assert found.chosen.key == "stribeck_load_friction" and [s.key for s in found.equivalent] == [
        "load_friction"
    ]
    assert passing(naming, 18.0) is naming, "both pass: the simpler one"
    assert passing(naming, 22.0).chosen is naming.chosen, "neither passes"

"""Comparisons of models: the paper's p-values from its table, errors in its units, tests that see what differs."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from dynreg.errors import SimulationError, UsageError
from dynreg.results import Errors
from dynreg.rng import stream
from dynreg.timed.commands import AXES
from dynreg.timed.compare import compared, holm, judged, paired_chance

# Pretorius et al., Table III: mean and standard deviation of 230 absolute errors
PUBLISHED = {
    "dx": {"network": (0.4483, 0.5485), "dynamic": (0.3467, 0.6586), "kinematic": (1.0093, 1.7967)},
    "dy": {"network": (0.6241, 0.6014), "dynamic": (0.3628, 0.4363), "kinematic": (1.2788, 1.5346)},
    "dtheta": {"network": (3.0239, 3.3638), "dynamic": (4.1985, 3.9652), "kinematic": (13.2385, 10.1716)},
}
TUKEY = {"dx": 0.612, "dy": 0.013, "dtheta": 0.138}  # network against dynamic, as published


def sample(mean: float, sd: float, seed: int) -> np.ndarray:
    """(230,) numbers of exactly this mean and standard deviation."""
    z = stream(seed, "sample").standard_normal(230)
    return mean + sd * (z - z.mean()) / z.std(ddof=1)


@pytest.mark.parametrize("axis", AXES)
def test_tukeys_test_gives_the_published_p_values(axis: str) -> None:
    errors = {name: sample(*told, i) for i, (name, told) in enumerate(PUBLISHED[axis].items())}
    whole, pairs = judged(errors, axis, "cm")
    assert (whole.between, whole.within) == (2, 687) and whole.p < 1e-6
    told = {(p.first, p.second): p for p in pairs}
    near = told["network", "dynamic"]
    assert near.tukey == pytest.approx(TUKEY[axis], abs=0.003)
    assert near.difference == pytest.approx(PUBLISHED[axis]["network"][0] - PUBLISHED[axis]["dynamic"][0])
    assert near.low < near.difference < near.high and (near.low < 0 < near.high) == (near.tukey > 0.05)
    assert told["network", "kinematic"].tukey < 1e-5 and told["dynamic", "kinematic"].tukey < 1e-5


def test_an_interval_and_a_p_value_are_those_of_scipy() -> None:
    errors = {name: stream(i, name).gamma(1.0 + 0.2 * i, 1.0, 12) for i, name in enumerate("abc")}
    said = stats.tukey_hsd(*errors.values())
    interval = said.confidence_interval(0.95)
    _, pairs = judged(errors, "dx", "cm")
    for pair, at in zip(pairs, ((0, 1), (0, 2), (1, 2)), strict=True):
        ours = (pair.difference, pair.low, pair.high, pair.tukey)
        theirs = (said.statistic[at], interval.low[at], interval.high[at], said.pvalue[at])
        assert ours == pytest.approx(theirs, rel=1e-12)


def test_errors_are_told_in_centimetres_and_degrees() -> None:
    moved = np.array([[0.01, -0.02, 0.1], [0.03, 0.04, -0.3], [0.0, 0.0, 0.2]])
    off = np.array([0.01, -0.02, np.radians(5.0)]) * [[0.5], [1.0], [1.5]]
    found = Errors.model_validate(compared(moved, {"right": moved, "off": moved + off}))
    assert found.commands == 3
    assert [found.models["off"][axis].mean for axis in AXES] == pytest.approx([1.0, 2.0, 5.0])
    assert [found.models["off"][axis].unit for axis in AXES] == ["cm", "cm", "deg"]
    assert found.models["right"]["dx"].max == 0.0
    assert found.displacements == pytest.approx({"dx": 4 / 3, "dy": 2.0, "dtheta": np.degrees(0.2)})
    assert len(found.to_frame()) == 6 and {*found.tables()} == {"errors", "analysis of variance", "pairs"}


def test_a_paired_test_sees_what_tukeys_does_not() -> None:
    """One model is always a little worse than the other, on commands that differ a thousand times as much."""
    size = np.exp(stream(3, "sizes").normal(0.0, 2.0, 60))
    same = {"a": size, "b": 1.01 * size, "c": size}
    _, pairs = judged(same, "dx", "cm")
    told = {(p.first, p.second): p for p in pairs}
    assert told["a", "b"].paired < 1e-6 < 0.5 < told["a", "b"].tukey
    assert told["a", "c"].paired == 1.0 and told["a", "c"].difference == 0.0


@pytest.mark.parametrize(("alike", "many"), [(0.0, 230), (0.5, 230), (0.9, 2003)])
def test_models_that_err_alike_are_seldom_told_apart_though_neighbouring_commands_do_too(
    alike: float, many: int
) -> None:
    """Taken for independent, differences that last called 26 to 63 % of such models different."""
    rng, draws = stream(int(10 * alike), "alike"), 400
    noise = rng.standard_normal((draws, many)) * np.sqrt(1.0 - alike**2)
    noise[:, 0] = rng.standard_normal(draws)
    found = [paired_chance(one) < 0.05 for one in lfilter([1.0], [1.0, -alike], noise, axis=1)]
    assert np.mean(found) < 0.08


def test_a_steady_difference_is_seen_through_errors_that_last() -> None:
    noise = stream(1, "steady").standard_normal(2003)
    assert paired_chance(lfilter([1.0], [1.0, -0.5], noise) + 0.5) < 0.001
    assert paired_chance(np.full(3, 0.1)) == 0.25 and paired_chance(np.zeros(3)) == 1.0


def test_p_values_hold_together_by_holms_method() -> None:
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
    assert holm([0.5, 0.9]) == pytest.approx([1.0, 1.0]) and holm([0.2]) == [0.2]


def test_axes_without_scatter_have_honest_numbers() -> None:
    """A recording in which nothing turned: every model is right, or off by the same on every command."""
    moved = np.array([[0.01, -0.02, 0.0], [0.03, 0.04, 0.0], [0.0, 0.0, 0.0]])
    off = np.array([[0.01, 0.0, 0.5], [0.02, 0.0, 0.5], [0.05, 0.0, 0.5]])
    found = Errors.model_validate(compared(moved, {"right": moved, "same": moved.copy(), "off": moved + off}))
    whole = {v.axis: v for v in found.variance}
    assert (whole["dy"].f, whole["dy"].p) == (0.0, 1.0)
    assert (whole["dtheta"].f, whole["dtheta"].p) == (None, 0.0) and 0 < whole["dx"].p < 1
    pairs = {(p.axis, p.first, p.second): p for p in found.pairs}
    alike, apart = pairs["dtheta", "right", "same"], pairs["dtheta", "right", "off"]
    assert (alike.difference, alike.low, alike.high, alike.tukey, alike.paired) == (0.0, 0.0, 0.0, 1.0, 1.0)
    half = -np.degrees(0.5)
    assert (apart.difference, apart.low, apart.high) == pytest.approx(
        (half, half, half)
    ) and apart.tukey == 0.0
    assert pairs["dy", "right", "off"].tukey == 1.0
    kept = Errors.model_validate(found)
    assert Errors.model_validate(kept.to_dict()) == kept


def test_a_prediction_that_is_no_number_is_refused() -> None:
    moved = stream(1, "moved").standard_normal((5, 3))
    wild = moved.copy()
    wild[2:, 1] = np.inf
    with pytest.raises(SimulationError, match="model 'wild' diverges on 3 of 5 commands"):
        compared(moved, {"right": moved, "wild": wild})


def test_a_model_that_may_have_seen_the_commands_is_not_ranked() -> None:
    noise = stream(5, "noise").standard_normal((3, 40, 3))
    moved = noise[0]
    given = {"fitted": moved, "a": moved + 0.1 * noise[1], "b": moved + 0.2 * noise[2]}
    assert compared(moved, given).best == "fitted"
    found = compared(moved, given, ["fitted"])
    assert found.best == "a" and found.seen == ("fitted",) and "fitted" in found.models
    assert [(p.first, p.second) for p in found.pairs] == [("a", "b")] * 3
    alone = compared(moved, {name: given[name] for name in ("fitted", "a")}, ["fitted"])
    assert alone.best == "a" and alone.pairs == () and len(alone.variance) == 3


def test_one_model_or_two_commands_are_refused() -> None:
    moved = np.zeros((3, 3))
    for given, predicted in ((moved, {"a": moved}), (moved[:2], {"a": moved[:2], "b": moved[:2]})):
        with pytest.raises(UsageError, match="models on"):
            compared(given, predicted)

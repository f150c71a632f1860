"""Fits: they stop where nothing is gained, never do worse, and come as near as the truth does on the ground, too."""

from dataclasses import replace

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain, with_effect
from legs import calibrated, over_its_stop

from dynreg.diagnose.plans import Contact
from dynreg.diagnose.plans.polish import polish
from dynreg.evidence.accuracy import ROUGH, Accuracy, rough
from dynreg.evidence.data import UNSTATED
from dynreg.evidence.fit import best_of, carried, fit
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Ask, run
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import sensitivities


class Told:
    """Answers that gain in the iterations whose bits are in `gains`, and nothing in others."""

    def __init__(self, sides: int, gains: int):
        accuracy = Accuracy(4.0, fine=True, slopes=2.0, width=ROUGH, sides=sides)
        model, self.data = held_against_zero("zero_offset", accuracy=accuracy, tolerance=10.0)
        self.model, self.gains, self.ends = model.fine, gains, []
        self.derived = next(self.model.sloped.residuals([plain(0.0)], self.sample))[0].robot

    @property
    def sample(self):
        return self.data.sample(self.data.fit)

    def answer(self, one: Ask) -> np.ndarray:
        if one.robot is self.derived:
            self.ends.append(self.model.coordinates.from_values(one.case.values)[:, 0])
        gained = sum(self.gains >> i & 1 for i in range(len(self.ends)))
        return first_channel(one, 0.5**gained)

    def fitted(self, iterations: int = 9):
        return answered(fit(self.model, [plain(0.5)], self.sample, iterations=iterations), self.answer)


@pytest.mark.parametrize(
    ("sides", "gains", "iterations"),
    [(2, 0, 2), (1, 0, 1), (2, 0b11, 4), (2, 0b01, 3), (1, 0b01, 2), (1, 0b10, 1)],
)
def test_a_fit_goes_on_until_derivatives_to_either_side_gain_nothing(sides, gains, iterations):
    told = Told(sides, gains)
    told.fitted()
    assert len(told.ends) == iterations


def test_a_window_at_rest_hides_no_others_where_no_noise_is_stated():
    """Every simulator rests in the second window, to the bit; the first one tells the parameter."""
    model, data = held_against_zero("zero_offset", tolerance=10.0)
    quiet = replace(data, noise=np.zeros_like(data.noise))

    def answer(one: Ask) -> np.ndarray:
        off = model.coordinates.from_values(one.case.values)[:, 0] - 0.3
        moving = np.array([1.0, 0.0])[None, :, None] * np.sin(np.arange(40))
        return first_channel(one, off[:, None, None] * moving)

    with np.errstate(all="raise"):
        (found,), cost = answered(fit(model, [model.start], quiet.sample(quiet.fit), iterations=8), answer)
    assert np.isfinite(cost).all()
    assert found.nominal[0] == pytest.approx(0.3, abs=1e-4)
    np.testing.assert_array_equal(quiet.floor, UNSTATED**2)
    np.testing.assert_array_equal(data.floor, (data.noise / data.windows.spread)[data.use] ** 2)


def test_derivatives_to_one_side_are_taken_to_either_in_turn():
    told = Told(2, 0b1111)
    told.fitted(iterations=4)
    towards = [abs(end) < abs(here) or (here > 0) != (end > 0) for here, end in told.ends]
    assert towards == [True, False, True, False]


def test_a_fit_finds_the_minimum_and_leaves_what_is_hopeless_behind():
    """Of two hypotheses whose residuals are lines and a rest that nothing explains."""
    model, data = held_against_zero("zero_offset", "resistance")
    sample = data.sample(data.fit)
    noise = np.random.default_rng(0).standard_normal((1, 40))
    seen: list[int] = []

    def answer(one: Ask) -> np.ndarray:
        z = model.coordinates.from_values(one.case.values)
        loaded = np.full(len(z), one.case.terms is not None)
        if one.case.terms:
            loaded = np.isfinite(one.case.terms.values[0]).all(axis=1)
        seen.append(int(loaded.sum()))
        return first_channel(
            one, (0.02 * (z[:, 0] - 0.8) + np.where(loaded, 3.0, 0.0))[:, None, None] + 0.01 * noise
        )

    starts = [plain(-1.0, 0.0), with_effect("payload", -1.0, 0.0)]
    far, cost = answered(fit(model, starts, sample, iterations=6, tolerance=0.0, hopeless=50.0), answer)
    assert far[0].z[0] == pytest.approx(0.75, abs=0.25) and cost[1] > cost[0] + 50.0
    assert seen[-1] == 0 < seen[0], "what is hopeless is not simulated to the end"
    assert best_of(far, cost)[0] is far[0] and best_of(far, cost, 1) == far[:1]


def test_known_derivatives_lead_to_the_same_optimum():
    found = calibrated("coulomb_friction[knee]")
    model, base, sample = found.model, found.point, found.sample
    point = with_effect("coulomb_friction[knee]", *base.nominal)
    _, (slope,) = run(sensitivities(model, [base], sample))
    (full,), cost = run(fit(model, [point], sample, iterations=6))
    (quick,), price = run(fit(model, [point], sample, iterations=6, leading=slope))
    assert quick.effect[0] == pytest.approx(full.effect[0], rel=0.1)
    assert price[0] == pytest.approx(cost[0], abs=5.0)


def test_polishing_comes_as_near_as_the_truth_and_never_does_worse():
    model, data, hidden = over_its_stop(0.2)
    model = replace(model, accuracy=rough(model.robot))
    z, sample = model.coordinates.from_values(hidden.parameters), data.sample(data.fit)
    start = Point(Hypothesis(), z + np.where(np.arange(len(z)) % 2, 0.5, -0.5), np.zeros(0))
    truth = Point(Hypothesis(), z, np.zeros(0))
    (found,), residuals = run(polish(model, [start], sample, iterations=Contact().polished))
    points = [start, found, truth]
    made = run(model.fine.residuals(points, sample))
    assert np.array_equal(made[1], residuals[0]), "told with the finer time step"
    cost = objective(points, made, sample.reweighted(made[2]))
    assert cost[1] < cost[0]
    assert cost[1] - cost[2] < 0.3 * (cost[0] - cost[2])


class Dear:
    """A robot on its feet as one with many parameters: its residual bends with its only coordinate."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("dynreg.evidence.model.MANY", 0)
        accuracy = Accuracy(4.0, fine=True, slopes=2.0, width=ROUGH, sides=2)
        self.model, data = held_against_zero("zero_offset", accuracy=accuracy, tolerance=10.0)
        self.sample, self.asked = data.sample(data.fit), []

    def answer(self, one: Ask) -> np.ndarray:
        self.asked.append(len(one.case.values))
        z = self.model.coordinates.from_values(one.case.values)[:, 0][:, None, None]
        return first_channel(one, 0.1 * (z - 1.0) + 0.02 * (z - 1.0) ** 2)

    def fitted(self, known: dict | None = None):
        return answered(fit(self.model, [plain(-0.5)], self.sample, iterations=9, known=known), self.answer)


def test_derivatives_that_are_dear_are_carried_on_to_the_same_answer(monkeypatch: pytest.MonkeyPatch):
    dear = Dear(monkeypatch)
    (found,), cost = dear.fitted()
    carried_on = len(dear.asked)
    monkeypatch.setattr("dynreg.evidence.model.MANY", 9)
    dear.asked.clear()
    (usual,), usual_cost = dear.fitted()
    assert found.z == pytest.approx(usual.z, abs=0.02) and cost == pytest.approx(usual_cost, abs=0.1)
    assert carried_on < len(dear.asked), "it measures fewer derivatives"


def test_a_second_fit_goes_on_with_the_derivatives_of_the_first(monkeypatch: pytest.MonkeyPatch):
    dear, known = Dear(monkeypatch), {}
    (found,), _ = dear.fitted(known)
    assert [*known] == [found]
    dear.asked.clear()
    answered(fit(dear.model, [found], dear.sample, iterations=1, known=known), dear.answer)
    assert len(dear.asked) == 2, "the point, and steps from it; no derivatives"


def test_carried_derivatives_explain_the_step_and_change_nothing_across_it():
    rng = np.random.default_rng(3)
    slope, step, change = rng.normal(size=(4, 2, 5, 3)), rng.normal(size=4), rng.normal(size=(2, 5, 3))
    found = carried(slope, step, change)
    assert np.tensordot(step, found, axes=1) == pytest.approx(change)
    across = np.linalg.svd(step[None])[2][1:]  # (3, 4)
    assert np.tensordot(across, found, axes=1) == pytest.approx(np.tensordot(across, slope, axes=1))

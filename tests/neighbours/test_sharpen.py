"""Simulated slopes lead to the best parameters, and intervals say what is known of them and no more."""

import numpy as np
import pytest
from planted_map import NAMES, ROWS, TRUTH, WINDOWS, Plant, space, started

from dynreg.neighbours.intervals import Evidence, Interval, estimates
from dynreg.neighbours.sharpen import ROUNDS, Made, cost, promised, sharpen
from dynreg.neighbours.synthesise import Replays, linearise, refine
from dynreg.replay.start_error import StartSlopes, believed
from dynreg.rng import stream

SPACE = space()


def found(
    plant: Plant, replays: Replays, budget: int, halved: np.ndarray | None = None
) -> dict[str, Interval]:
    """The intervals after as many rounds as the budget allows; halved : change with half the time step."""
    made = sharpened(plant, replays, budget)
    local = made.local or linearise(made.replays)
    change = np.zeros(1) if halved is None else halved
    evidence = Evidence(WINDOWS * ROWS, made.replays.residuals[[made.best]] + change)
    return estimates(made.replays, local, made.replays.unit[made.best], evidence, SPACE.from_unit)[0]


def sharpened(plant: Plant, replays: Replays, budget: int) -> Made:
    """What is made of the best of the replays, whose start states are sure."""
    (residual,) = plant.residuals(replays.unit[[int(replays.score.argmin())]])
    return sharpen(replays, residual, plant.residuals, believed(residual), budget)


@pytest.mark.parametrize("curvature", [0.0, 0.5, 0.9])
def test_it_ends_at_the_optimum(curvature):
    """Ten times nearer than the regressed slopes come."""
    plant = Plant(curvature)
    begun = refine(started(SPACE, plant), plant.residuals, 6, seed=0)
    made = sharpened(plant, begun, ROUNDS * cost(4))
    assert np.abs(made.replays.unit[made.best] - TRUTH).max() < 0.003
    np.testing.assert_array_equal(made.local.centre, made.replays.unit[made.best])
    own = plant.residuals(made.replays.unit[[made.best]])[0]
    np.testing.assert_allclose(made.residual, own, atol=1e-12)


def test_a_search_that_ended_promises_nothing_and_one_on_its_way_much():
    plant = Plant(0.0, noise=0.02)
    begun = started(SPACE, plant)
    ended = sharpened(plant, begun, ROUNDS * cost(4))
    assert promised(ended.local, begun.free) > 0.98
    best = begun.unit[[int(begun.score.argmin())]]
    begins = linearise(begun)
    ratio = np.abs(plant.residuals(best)).mean() / np.abs(ended.residual).mean()
    assert promised(begins, begun.free) < 0.5 and ratio > 2


@pytest.mark.parametrize("budget", [0, cost(4) - 1, cost(4), 2 * cost(4) + 5, 100])
def test_it_takes_whole_rounds_within_the_budget(budget):
    plant, asked = Plant(2.0, noise=0.001), []
    begun, whole = started(SPACE, plant), plant.residuals

    def counted(unit: np.ndarray) -> np.ndarray:
        asked.append(len(unit))
        return whole(unit)

    (residual,) = whole(begun.unit[[int(begun.score.argmin())]])
    made = sharpen(begun, residual, counted, believed(residual), budget)
    assert sum(asked) <= budget and sum(asked) % cost(4) == 0 and sum(asked) <= ROUNDS * cost(4)
    assert (made.local is None) == (budget < cost(4)) == (not asked)


def test_it_stays_inside_the_ranges_and_leaves_what_is_known():
    plant = Plant(2.0)
    begun = started(SPACE, plant, free=(True, False, True, True))
    begun.unit[:, 0] = np.round(begun.unit[:, 0])  # at an edge there is one side alone
    made = sharpened(plant, begun, ROUNDS * cost(3))
    unit = made.replays.unit
    assert unit.min() >= 0 and unit.max() <= 1 and (unit[:, 1] == TRUTH[1]).all()
    assert np.isfinite(made.local.jacobian).all() and made.local.jacobian.shape[1] == 3


@pytest.mark.parametrize("budget", [0, ROUNDS * cost(4)])
@pytest.mark.parametrize("curvature", [0.0, 0.5])
def test_most_intervals_hold_the_truth(curvature, budget):
    """Of 80 at 90 %, fewer than 62 once in 1000; they are as narrow as noise of 0.1 allows."""
    held, width = 0, []
    for seed in range(20):
        plant = Plant(curvature, noise=0.1, seed=seed)
        told = found(plant, refine(started(SPACE, plant), plant.residuals, 15, seed=0), budget)
        held += sum(told[n].low <= 10 * t <= told[n].high for n, t in zip(NAMES, TRUTH, strict=True))
        width += [e.high - e.low for e in told.values()]
    assert held >= 62
    assert np.median(width) < 0.5, "of a range of 10"


def test_what_lasts_through_a_window_widens_the_intervals():
    """The model is wrong by another amount in each window: as many samples as rows would make it too sure."""
    widths = [
        np.median([e.high - e.low for e in found(plant, started(SPACE, plant), ROUNDS * cost(4)).values()])
        for plant in (Plant(noise=0.05), Plant(noise=0.05, drift=0.5))
    ]
    assert widths[1] > 3 * widths[0]


def test_what_half_the_time_step_changes_widens_the_intervals():
    """It acts as parameter a does, 0.05 of its range: halved for ever it would reach twice as far."""
    plant = Plant(noise=0.01)
    replays = started(SPACE, plant)
    change = 0.05 * plant.slopes[0][None, :3]
    plain = found(plant, replays, ROUNDS * cost(4))
    wide = found(plant, replays, ROUNDS * cost(4), change)
    assert wide["a"].high - wide["a"].value == pytest.approx(2 * 0.05 * 10, rel=0.1)
    assert wide["a"].value - wide["a"].low == pytest.approx(2 * 0.05 * 10, rel=0.1)
    for name in "bcd":
        assert wide[name].high - wide[name].low < 2 * (plain[name].high - plain[name].low)


@pytest.mark.parametrize("budget", [0, ROUNDS * cost(4)])
def test_parameters_that_can_make_up_for_each_other_get_their_whole_ranges(budget):
    """Their sum is known well, their difference not at all, though noise makes every replay differ."""
    plant = Plant(0.3, twins=True)
    told = found(plant, refine(started(SPACE, plant), plant.residuals, 15, seed=0), budget)
    assert told["c"].value + told["d"].value == pytest.approx(10 * (TRUTH[2] + TRUTH[3]), abs=0.5)
    for name in ("c", "d"):
        assert told[name].high - told[name].low > 4
    for name in ("a", "b"):
        assert told[name].high - told[name].low < 2


def test_what_is_known_has_no_interval_and_what_lies_at_an_edge_is_told():
    replays = started(SPACE, Plant(), free=(True, False, True, True))
    point = np.array([1.0, TRUTH[1], 0.5, 0.5])
    local = linearise(replays)
    evidence = Evidence(100, replays.residuals[[int(replays.score.argmin())]])
    told, _ = estimates(replays, local, point, evidence, SPACE.from_unit)
    assert told["b"].low == told["b"].value == told["b"].high == pytest.approx(8.0)
    assert [told[name].at_bound for name in NAMES] == [True, False, False, False]


class Slipping(Plant):
    """In its second window the motion is another one wherever a parameter moves, as after a foot that slips."""

    def residuals(self, unit: np.ndarray) -> np.ndarray:
        found = super().residuals(unit)
        for row, at in zip(found, unit, strict=True):
            bits = np.floor(1e4 * at).astype(int)
            row[1] += 0.3 * stream(int(np.abs(bits).sum()), "slip").normal(size=row[1].shape)
        return found


def test_a_window_in_which_all_hangs_on_chance_takes_nothing_from_the_others():
    """Its slopes are noise of a size that would drown those of the rest."""
    plant = Slipping(noise=0.02)
    told = found(plant, refine(started(SPACE, plant), plant.residuals, 15, seed=0), ROUNDS * cost(4))
    for name, truth in zip(NAMES, TRUTH, strict=True):
        assert told[name].low <= 10 * truth <= told[name].high
        assert told[name].high - told[name].low < 2.0, "of a range of 10"


class Noisy(Plant):
    """Its windows start from states that are wrong, and what that does looks like parameter a: as noise of a start
    speed does like a friction.
    """

    def __init__(self, seed: int):
        super().__init__(noise=0.02, seed=seed)
        rng = stream(seed, "starts")
        self.start = np.zeros((WINDOWS, ROWS, 1))
        self.start[:, :, 0] = self.slopes[0, :, :, 0] * np.linspace(1.0, 0.0, ROWS)
        self.start += 0.3 * rng.normal(size=self.start.shape)
        self.noise += 0.3 * rng.normal(size=(WINDOWS, 1, 1)) * self.start


def test_errors_of_start_states_are_fitted_along_with_the_parameters():
    """Each within its noise, 0.3 here: answers come nearer the truth, and intervals hold it as often as they say."""
    wrong, width, held = {True: [], False: []}, [], 0
    for seed in range(20):
        plant = Noisy(seed)
        begun = refine(started(SPACE, plant), plant.residuals, 15, seed=0)
        (residual,) = plant.residuals(begun.unit[[int(begun.score.argmin())]])
        told = StartSlopes(np.arange(1), 0.3 * plant.start.reshape(WINDOWS, -1, 1), np.array([0.02]))
        for fitted, slopes in ((True, told), (False, believed(residual))):
            made = sharpen(begun, residual, plant.residuals, slopes, ROUNDS * cost(4))
            unit = made.replays.unit[made.best]
            wrong[fitted].append(np.abs(unit - TRUTH).mean())
            if fitted:
                evidence = Evidence(WINDOWS * ROWS, made.replays.residuals[[made.best]])
                found, _ = estimates(made.replays, made.local, unit, evidence, SPACE.from_unit)
                width += [found[n].high - found[n].low for n in NAMES]
                held += sum(
                    found[n].low <= 10 * t <= found[n].high for n, t in zip(NAMES, TRUTH, strict=True)
                )
    assert np.mean(wrong[True]) < 0.5 * np.mean(wrong[False])
    assert held >= 62 and np.median(width) < 0.2, "of a range of 10"

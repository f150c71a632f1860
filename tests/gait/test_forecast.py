"""What gaits will do on a robot after trials of some, and which one it shall try next."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.gait.forecast import COMPARED, DOUBT, SECOND, Forecast, best_first, forecast, new_does_more
from dynreg.gait.had import Had
from dynreg.gait.near import MORE_FALLS
from dynreg.gait.seek import EXPECTED, UNSEEN
from dynreg.gait.trials import Trials

FELL = -999.0
SIMULATORS, RUNS = 2, 8000  # so many draws of each that what is estimated is what was drawn


def gaits(many: int) -> tuple[tuple[float, ...], ...]:
    return tuple((float(i), 0.5) for i in range(many))


def had(*reached: float, walked: tuple[bool, ...] = ()) -> Had:
    return Had(gaits(len(reached)), reached, walked or (True,) * len(reached))


def foretold(monkeypatch: pytest.MonkeyPatch, trials: Trials, runs: np.ndarray) -> list:
    """Runs (2, n, draws, 2) that simulators give, twice with the same parameters; what was asked."""
    asked, runs = [], [*runs]

    def again(genes: np.ndarray, draws: int, *, first: int, doubt: float, moved: int) -> np.ndarray:
        asked.append((genes, draws, first, doubt, moved))
        return runs[len(asked) % 2 - 1]

    monkeypatch.setattr(trials, "again", again)
    return asked


def drawn(means: list[float], shared: np.ndarray, noise: list[float]) -> np.ndarray:
    """Runs of gaits whose values scatter by a covariance (n, n) over simulators, each run with noise of its own.

    Noise is the same of all gaits, as in one draw of it.
    """
    rng = np.random.default_rng(0)
    value = rng.multivariate_normal(means, shared, (RUNS, SIMULATORS)).transpose(2, 0, 1)
    return value + np.array(noise)[:, None, None] * rng.normal(size=(2, 1, RUNS, SIMULATORS))


def test_a_trial_counts_as_far_as_it_is_no_luck(trials, monkeypatch) -> None:
    for noise, share in ((0.01, 1.0), (1.0, 0.5), (3.0, 0.1)):
        foretold(monkeypatch, trials, drawn([2.0], np.eye(1), [noise]))
        (value,) = forecast(trials, had(4.0)).values
        assert value == pytest.approx(2.0 + share * 2.0, abs=0.15)


def test_a_trial_of_one_gait_tells_of_those_about_which_simulators_are_wrong_alike(
    trials, monkeypatch
) -> None:
    shared = np.array(
        [[1.0, 0.8, 0.0, -0.5], [0.8, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-0.5, 0.0, 0.0, 1.0]]
    )
    asked = foretold(monkeypatch, trials, drawn([1.0, 2.0, 3.0, 4.0], shared, [1.0, 0.1, 0.1, 0.1]))
    told = forecast(trials, had(3.0), *np.array(gaits(4)[1:]))
    assert told.values == pytest.approx([2.0, 2.8, 3.0, 3.5], abs=0.15)
    draws = EXPECTED // SIMULATORS
    assert [one[1:] for one in asked] == [(draws, at, DOUBT, COMPARED) for at in (COMPARED, SECOND)]
    assert SECOND >= COMPARED + draws and COMPARED >= UNSEEN + EXPECTED  # draws that no search has seen
    assert all(np.array_equal(genes, gaits(4)) for genes, *_ in asked)


def test_it_is_the_mean_of_a_gaussian_given_all_trials(trials, monkeypatch) -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    means, noise, reached = np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 0.2]), np.array([2.0, 1.0])
    foretold(monkeypatch, trials, drawn(means.tolist(), root @ root.T, noise.tolist()))
    precise = np.linalg.inv(root @ root.T)  # by Bayes' rule with precisions, another way round
    trial = np.diag([*1.0 / noise[:2] ** 2, 0.0])
    given = np.linalg.solve(precise + trial, precise @ means + trial @ np.array([*reached, 0.0]))
    assert forecast(trials, had(*reached), np.array([2.0, 0.5])).values == pytest.approx(given, abs=0.15)


def test_the_same_gait_twice_has_two_trials(trials, monkeypatch) -> None:
    foretold(monkeypatch, trials, drawn([0.0, 0.0], np.ones((2, 2)), [1.0, 1.0]))
    told = forecast(trials, Had(gaits(1) * 2, (3.0, 0.0), (True, True))).values
    assert told == pytest.approx([1.0, 1.0], abs=0.1)  # (3 + 0) / 3, with what was foreseen as a third
    assert told[0] == pytest.approx(told[1], abs=0.02), "of one gait there is one forecast"


def test_where_simulators_agree_the_trial_counts(trials, monkeypatch) -> None:
    for grade, value in ((2.0, 2.0), (FELL, 0.0)):  # where all fall, they agree, too
        foretold(monkeypatch, trials, np.full((2, 3, RUNS, SIMULATORS), grade))
        told = forecast(trials, had(5.0, 1.0), np.array([2.0, 0.5]))
        assert told.values == pytest.approx([5.0, 1.0, value])
        assert told.falls.tolist() == [float(grade == FELL)] * 3
    runs = drawn([2.0, 0.0], np.diag([1.0, 0.0]), [1.0, 0.0])
    runs[:, 1] = FELL  # it fell in all of them, and the other did not
    foretold(monkeypatch, trials, runs)
    assert forecast(trials, had(2.0, 3.1)).values == pytest.approx([2.0, 3.1], abs=0.1)


def test_what_scatters_by_noise_alone_is_no_error_of_the_simulators(trials, monkeypatch) -> None:
    luck = np.random.default_rng(4).normal(size=(3, RUNS, SIMULATORS))
    foretold(
        monkeypatch, trials, 2.0 + np.stack([luck, -luck])
    )  # by chance, the pairs differ more than others
    told = forecast(trials, had(3.0, 1.0), np.array([2.0, 0.5])).values
    assert told == pytest.approx([2.0, 2.0, 2.0], abs=0.1)


def test_in_simulators_it_is_the_same_each_time_and_a_far_off_trial_tells_more(trials, monkeypatch) -> None:
    space, again, seen = trials.space, trials.again, []
    monkeypatch.setattr(trials, "again", lambda *a, **how: seen.append(again(*a, **how)) or seen[-1])
    genes = space.feasible(space.from_unit(space.starts[:3]))

    def tell(*reached: float) -> Forecast:
        tried = Had(tuple(map(tuple, genes[:2])), reached, (False, False))
        return forecast(trials, tried, genes[2])

    low, same, high = tell(0.1, 0.1), tell(0.1, 0.1), tell(0.4, 0.4)
    assert np.array_equal(low.values, same.values) and np.array_equal(low.falls, same.falls)
    fell = [np.count_nonzero(runs < 0.5 * FELL, axis=(1, 2)) for runs in seen[:2]]
    assert low.falls == pytest.approx(sum(fell) / (2 * EXPECTED))
    assert (high.values[:2] > low.values[:2]).all() and np.isfinite(high.values).all()


def test_those_that_walked_come_first_then_the_highest_forecast(trials, monkeypatch) -> None:
    luck = [0.01, 1.0, 0.01, 0.01]
    foretold(monkeypatch, trials, drawn([2.0, 1.0, 9.0, 3.0], np.eye(4), luck))
    tried = had(2.0, 2.5, 0.0, 3.0, walked=(True, True, False, True))
    told = best_first(trials, replace(tried, simulators=("a", "b")))
    at = [3, 0, 1, 2]  # the second had luck: 1.75
    assert told.genes == tuple(tried.genes[i] for i in at) and told.reached == (3.0, 2.0, 2.5, 0.0)
    assert told.walked == (True, True, True, False) and told.simulators == ("a", "b")
    one = had(1.0)
    assert best_first(trials, one) is one


def test_each_gait_has_one_trial() -> None:
    with pytest.raises(
        UsageError, match="2 gaits, 1 values and 2 ends of trials; expected one trial of each"
    ):
        Had(gaits(2), (1.0,), (True, True))


# {case: (what simulators say of the gait that walked, of one near it, of a new one, and its share of falls; alike
#         with the first; what that reached; the new one?)}
CASES = {
    "what is near gains as simulators say": ([2.0, 3.0, 4.7], 0.0, 0.0, 4.0, False),
    "the new one gains more": ([2.0, 3.0, 5.3], 0.0, 0.0, 4.0, True),
    "it gains where simulators are wrong about it alike": ([2.0, 3.0, 3.3], 0.0, 1.0, 4.0, True),
    "what is near loses": ([2.0, 1.0, 3.2], 0.0, 0.0, 4.0, True),
    "the robot reached what simulators say": ([2.0, 3.0, 3.3], 0.0, 0.0, 2.0, True),
    "a few falls are allowed": ([2.0, 3.0, 9.0], 0.9 * MORE_FALLS, 0.0, 2.0, True),
    "more are not": ([2.0, 3.0, 9.0], 1.5 * MORE_FALLS, 0.0, 2.0, False),
}


@pytest.mark.parametrize("case", CASES)
def test_that_one_is_tried_which_should_do_more_on_the_robot(case: str, trials, monkeypatch) -> None:
    means, falls, alike, reached, new = CASES[case]
    shared = np.array([[1.0, 1.0, alike], [1.0, 1.0, alike], [alike, alike, 1.0]])
    runs = drawn(means, shared, [0.01] * 3)
    runs[:, 2, : round(falls * RUNS)] = FELL
    foretold(monkeypatch, trials, runs)
    near, found = np.array(gaits(3)[1:])
    assert new_does_more(trials, had(reached), near, found) is new


@pytest.mark.parametrize("which", [0, 1])
def test_where_others_fall_as_often_a_new_one_may(which: int, trials, monkeypatch) -> None:
    runs = drawn([2.0, 3.0, 9.0], np.eye(3), [0.01] * 3)
    runs[:, [which, 2], : RUNS // 5] = FELL
    foretold(monkeypatch, trials, runs)
    assert new_does_more(trials, had(2.0), *np.array(gaits(3)[1:]))


def test_a_gait_that_the_robot_has_had_is_not_new(trials, monkeypatch) -> None:
    foretold(monkeypatch, trials, drawn([1.0, 1.0, 1.0, 9.0], np.eye(4), [0.01] * 4))
    tried, (near, new) = had(1.0, 1.0), np.array(gaits(4)[2:])
    assert new_does_more(trials, tried, near, new)
    assert not any(new_does_more(trials, tried, near, np.array(one)) for one in tried.genes)

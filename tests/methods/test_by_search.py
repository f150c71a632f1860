"""A search keeps its budget, begins with what is known and never ends worse, whichever it is."""

from dataclasses import replace

import numpy as np
import pytest
import secret_servo

from dynreg.errors import OldWord, UsageError
from dynreg.methods.answer import Answer
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.judged import replay_errors
from dynreg.methods.table import METHODS, SEARCHED
from dynreg.replay.data import Data, data
from dynreg.replay.windows import Replayer
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot
from dynreg.verbs.calibrate import CalibrateSettings
from dynreg.verbs.gait import GaitSettings

BUDGET = 33  # no multiple of any batch
SEARCHES = [name for name, kind in METHODS.items() if kind.where == SEARCHED]


def calibrate(data: Data, method: str, *, budget: int, seed: int = 0) -> Answer:
    return METHODS[method].made().fit(Question(data), Evidence(), Limits(budget, seed))


def recorded(values: np.ndarray, seed: int = 0) -> Data:
    log = secret_servo.record(values, seed, episodes=4, steps=60)
    return data(load_robot("servo_pendulum"), log)


@pytest.fixture(scope="module")
def secret() -> Data:
    return recorded(secret_servo.values_of(7), 7)


@pytest.fixture(scope="module")
def nominal() -> Data:
    """A robot that is as the folder says: anything else is worse."""
    return recorded(load_robot("servo_pendulum").space.nominal)


@pytest.fixture
def replayed(monkeypatch) -> list[tuple[np.ndarray, tuple[int, ...]]]:
    """Simulators and windows of every replay."""
    calls, states = [], Replayer.states

    def watch(self, values, chosen, initial=None):
        calls.append((values, tuple(int(w) for w in chosen)))
        return states(self, values, chosen, initial)

    monkeypatch.setattr(Replayer, "states", watch)
    return calls


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("search", SEARCHES)
def test_it_never_ends_worse_than_it_began(nominal: Data, search: str, seed: int) -> None:
    found = calibrate(nominal, search, budget=BUDGET, seed=seed)
    assert found.final.after <= found.final.before


@pytest.mark.parametrize("budget", [1, 2, BUDGET])
@pytest.mark.parametrize("search", SEARCHES)
def test_the_budget_is_kept_to_the_last_replay_and_the_nominal_is_in_it(
    secret: Data, search: str, budget: int, replayed
) -> None:
    found = calibrate(secret, search, budget=budget)
    chosen = tuple(np.flatnonzero(~secret.parts.test))
    assert {windows for _, windows in replayed} == {chosen}, "no method looks at what is held out"
    train = np.concatenate([values for values, _ in replayed])
    assert found.rollouts == len(train) == budget
    np.testing.assert_allclose(train[0], secret.robot.space.nominal)


@pytest.mark.parametrize("search", SEARCHES)
def test_errors_are_those_of_what_comes_back(secret: Data, search: str) -> None:
    found = calibrate(secret, search, budget=BUDGET)
    nominal, answer = (
        SimConfig.of(secret.robot, v) for v in (secret.robot.space.nominal, found.final.values)
    )
    train = replay_errors(secret, [nominal, answer])[:, 0]
    np.testing.assert_allclose(train, (found.final.before, found.final.after))
    spent, lowest = zip(*found.final.history, strict=True)
    assert (
        spent[0] == 1 and spent == tuple(sorted(set(spent))) and lowest == tuple(sorted(lowest, reverse=True))
    )
    assert (lowest[0], lowest[-1]) == (found.final.before, found.final.after) and spent[-1] == BUDGET


def test_a_planted_servo_is_fitted() -> None:
    log = secret_servo.record(secret_servo.values_of(7), 7)
    cut = data(load_robot("servo_pendulum"), log)
    found = calibrate(cut, "cma", budget=200)
    nominal, answer = (SimConfig.of(cut.robot, v) for v in (cut.start, found.final.values))
    before, after = replay_errors(cut, [nominal, answer])
    assert (after < 0.3 * before).all(), "on what is held out, too"


@pytest.mark.parametrize("share", [0.9, 1.5])
def test_what_the_log_tells_stays_beyond_its_range_too(secret: Data, share: float, replayed) -> None:
    known = np.full(len(secret.robot.space), np.nan)
    known[0] = share * secret.robot.space.bounds[0, 1]
    told = replace(secret, known=known)
    one = calibrate(told, "random", budget=12)
    assert all(np.allclose(values[:, 0], known[0]) for values, _ in replayed) and len(replayed) > 2
    assert one.final.values[0] == pytest.approx(known[0])


def test_where_all_is_known_there_is_nothing_to_search(secret: Data) -> None:
    every = calibrate(replace(secret, known=secret.robot.space.nominal), "cma", budget=12)
    assert every.rollouts == 1 and every.final.history == ((1, every.final.before),)
    assert every.final.before == every.final.after and every.ended == "nothing to fit"


def test_an_old_word_still_works_and_says_what_it_is_called_now() -> None:
    with pytest.warns(OldWord, match="'cmaes' is called 'cma' now"):
        assert CalibrateSettings(method="cmaes").method == "cma"
    with pytest.raises(UsageError, match="method 'ants'"):
        CalibrateSettings(method="ants")
    with pytest.warns(OldWord, match="'genetic' is called 'ga' now"):
        assert CalibrateSettings(method="genetic").method == "ga"
    with pytest.warns(OldWord, match="'genetic' is called 'ga' now"):
        assert GaitSettings(method="genetic").method == "ga"

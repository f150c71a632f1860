"""Draws that a recording leaves open replay it as the answer does, and differ where it tells nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
import secret_servo
from threadpoolctl import threadpool_info, threadpool_limits

from dynreg.neighbours.draws import TOLERANCE, drawn
from dynreg.neighbours.query import case_of, choose, distance_query
from dynreg.neighbours.retrieve import retrieve
from dynreg.neighbours.spending import Spending, usual_budget
from dynreg.neighbours.synthesise import replays_of
from dynreg.replay.windows import errors
from dynreg.rng import stream
from dynreg.sim.robot import load_robot
from dynreg.verbs.populations import load_population

SPACE = load_robot("servo_pendulum").space
TRUTH = np.full(len(SPACE), 0.4)
HELD = len(SPACE) - 1  # the last parameter is known of the robot


def residuals(unit: np.ndarray) -> np.ndarray:
    """(n, 4, 40, 2) of a log that tells the first parameter and the sum of the next two, with noise."""
    told = np.stack([unit[:, 0], unit[:, 1] + unit[:, 2]]) - np.array([[0.4], [0.8]])
    shapes = stream(1, "shapes").standard_normal((2, 4, 40, 2))
    noise = 0.05 * stream(2, "noise").standard_normal((4, 40, 2))
    return np.einsum("pn,pwts->nwts", told, shapes) + noise


@pytest.fixture(scope="module")
def linear() -> tuple[SimpleNamespace, SimpleNamespace]:
    """A case with such a log, and a choice whose answer is the best of its replays."""
    unit = np.concatenate([TRUTH[None], stream(3, "unit").uniform(0.1, 0.9, (60, len(SPACE)))])
    unit[:, HELD] = TRUTH[HELD]
    free, windows = np.arange(len(SPACE)) != HELD, np.arange(4)
    replays = replays_of(SPACE, free, np.ones(4, dtype=bool), unit, residuals(unit))
    replayer = SimpleNamespace(residuals=lambda values, chosen: residuals(SPACE.to_unit(values)))
    data = SimpleNamespace(values_of=SPACE.from_unit, parts=SimpleNamespace(chosen=windows))
    case = SimpleNamespace(replayer=replayer, data=data, report=lambda *_: None)
    return case, SimpleNamespace(replays=replays, answer=0)


def test_what_a_log_tells_is_kept_and_what_it_does_not_stays_open(linear) -> None:
    values = drawn(*linear, 16, 1)
    unit = SPACE.to_unit(values)
    assert len(unit) == 16 and unit[0] == pytest.approx(TRUTH)
    apart = unit - TRUTH
    assert np.abs(apart[:, 0]).max() < 0.05 and np.abs(apart[:, 1] + apart[:, 2]).max() < 0.08
    assert (apart[1:, 1] - apart[1:, 2]).std() > 0.15  # the two make up for each other
    assert (apart[1:, 3:HELD].std(axis=0) > 0.15).all() and (apart[:, HELD] == 0.0).all()
    assert ((unit > 1e-9) & (unit < 1.0 - 1e-9)).all()  # none beyond an edge, nor at one
    found = errors(residuals(unit)).mean(axis=1)
    assert (found <= TOLERANCE * found[0]).all()


def test_the_same_seed_draws_the_same_and_few_are_the_first_of_many(linear) -> None:
    many = drawn(*linear, 16, 1)
    assert np.array_equal(drawn(*linear, 4, 1), many[:4])
    assert not np.array_equal(drawn(*linear, 4, 2)[1:], many[1:4])


def test_where_no_draw_replays_as_well_the_answer_stands_alone(linear, monkeypatch) -> None:
    monkeypatch.setattr("dynreg.neighbours.draws.TOLERANCE", 0.0)
    assert len(drawn(*linear, 16, 1)) == 1


def test_a_draw_that_replays_better_than_the_answer_sets_the_measure(linear) -> None:
    """The answer errs by 1, every third draw by 0.5 or 0.57, the others by 0.6."""
    case, chosen = linear
    levels = {1: [1.0], 48: [0.5, 0.6, 0.6, 0.57, 0.6, 0.6] * 8}
    replayer = SimpleNamespace(
        residuals=lambda values, *_: (
            np.array(levels[len(values)])[:, None, None, None] * np.ones((1, 4, 40, 2))
        )
    )
    found = drawn(SimpleNamespace(**vars(case) | {"replayer": replayer}), chosen, 16, 1)
    every = drawn(case, chosen, 1 + 4 * 48, 1)
    assert len(found) == 16 and len(np.unique(found, axis=0)) == 16
    assert errors(replayer.residuals(np.zeros((48, 1)))).min() * TOLERANCE < 0.6 and len(every) > 16
    assert len(drawn(SimpleNamespace(**vars(case) | {"replayer": replayer}), chosen, 999, 1)) == 1 + 4 * 16


def test_of_a_secret_servo_draws_err_no_more_than_the_tolerance_allows(servos) -> None:
    recording = secret_servo.record(secret_servo.values_of(3), 3, episodes=3, steps=30)
    (record,) = servos.registry.populations()
    population = load_population(servos.registry, record.id, judged=True)
    case = case_of(population, recording, hold_out=None, threads=1, report=lambda *_: None)
    spending = Spending(5, usual_budget(case.robot, 5))
    chosen = choose(case, retrieve(distance_query(case, spending), "auto", guess=True), spending)
    values = drawn(case, chosen, 16, 1)
    assert len(values) > 1 and np.array_equal(
        values[0], case.data.values_of(chosen.replays.unit[chosen.answer])
    )
    found = errors(case.replayer.residuals(values, case.data.parts.chosen)).mean(axis=1)
    assert (found <= TOLERANCE * found[0]).all() and len({*found}) == len(found)


def test_linear_algebra_has_one_thread_while_one_is_chosen_or_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """With more it would add in another order: other bytes."""
    seen = []

    def stops(*_) -> None:
        seen.append({one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"})
        raise KeyboardInterrupt

    monkeypatch.setattr("dynreg.neighbours.query._replayed", stops)
    monkeypatch.setattr("dynreg.neighbours.draws.regressed", stops)
    case, chosen = SimpleNamespace(replayer=SimpleNamespace(rollouts=0)), SimpleNamespace(answer=0)
    case.data, chosen.replays = SimpleNamespace(values_of=None), SimpleNamespace(unit=[None])
    with threadpool_limits(2, user_api="blas"):
        for ask in (lambda: choose(case, None, None), lambda: drawn(case, chosen, 1, 0)):
            with pytest.raises(KeyboardInterrupt):
                ask()
    assert seen == [{1}, {1}]

"""The door of a robot that scores gaits: what trials cost, also those of which nothing tells how they ended."""

import numpy as np
import pytest

from dynreg.adapt.journalled import Outcome
from dynreg.errors import BudgetError, LogError
from dynreg.gait.tasks import task_of
from dynreg.methods.scored import ScoredRobot
from dynreg.sim.real import Budget, SimulatedRobot, Spent
from dynreg.sim.robot import Robot, load_robot

STEPS = 20


@pytest.fixture(scope="module")
def quadruped() -> Robot:
    return load_robot("quadruped")


def straight(robot: Robot) -> np.ndarray:
    """Commands of legs on which it falls."""
    return np.zeros((STEPS, len(robot.actions)))


def test_what_is_begun_costs_what_a_trial_with_an_error_costs(quadruped: Robot) -> None:
    def breaks(actions: np.ndarray, rate: float, name: str) -> float:
        raise LogError("no log", expected="one", do="log it")

    door = ScoredRobot(quadruped, task_of(quadruped), breaks, budget=Budget(trials=1))
    begun = door.begin(STEPS / quadruped.rate)
    with pytest.raises(LogError):
        door.try_out(straight(quadruped), quadruped.rate)
    later = ScoredRobot(quadruped, task_of(quadruped), breaks, budget=Budget(trials=1))
    later.again(begun)
    assert later.spent == door.spent == Spent(1, STEPS / quadruped.rate, 0)
    with pytest.raises(BudgetError):
        later.begin(0.1)


@pytest.mark.parametrize("what", ["trials", "seconds", "falls"])
def test_the_budget_that_is_spent_is_told(quadruped: Robot, what: str) -> None:
    budget = Budget(**{"trials": 9, "seconds": 9.0, "falls": 9, what: 1})
    door = ScoredRobot(quadruped, task_of(quadruped), lambda *_: None, budget=budget)
    door.again(Outcome(None, 0.5, 1, 1))
    with pytest.raises(BudgetError) as told:
        door.begin(0.6)
    assert told.value.what == what


def test_a_real_robot_counts_a_trial_of_an_interrupted_run_where_it_does_not_know_of_it(
    quadruped: Robot,
) -> None:
    task, real = task_of(quadruped), SimulatedRobot(quadruped, quadruped.space.nominal, seed=3, threads=1)
    real.run(straight(quadruped), quadruped.rate)  # before this run
    outcome = ScoredRobot(quadruped, task, real).try_out(straight(quadruped), quadruped.rate)
    assert (outcome.number, outcome.ever, outcome.fell) == (1, 2, True)
    spent, same = real.spent, ScoredRobot(quadruped, task, real)
    same.again(outcome)
    assert real.spent == spent and same.spent.trials == 1, "it is the one that made the trial"
    other = SimulatedRobot(quadruped, quadruped.space.nominal, seed=3, threads=1)
    door = ScoredRobot(quadruped, task, other)
    door.again(outcome)
    assert door.spent == other.spent == Spent(1, outcome.seconds, 1)
    assert door.begin(0.4).number == 2


@pytest.mark.parametrize(
    ("answer", "score"),
    [(None, None), ("Fell\n", None), (2, 2.0), (np.float32(0.5), 0.5), (np.int64(3), 3.0)],
)
def test_a_function_may_answer_with_a_number_or_a_fall(quadruped: Robot, answer, score) -> None:
    door = ScoredRobot(quadruped, task_of(quadruped), lambda *_: answer)
    outcome = door.try_out(straight(quadruped), quadruped.rate)
    assert outcome.score == score and door.spent.falls == outcome.fell == (score is None)


@pytest.mark.parametrize("answer", ["far", (1, 2), True, np.True_, np.zeros(2), [], {}, 1j, float("inf")])
def test_any_other_answer_is_refused_in_one_line_and_the_trial_counts(quadruped: Robot, answer) -> None:
    door = ScoredRobot(quadruped, task_of(quadruped), lambda *_: answer)
    with pytest.raises(LogError, match="a trial of task 'forward'.*expected a log"):
        door.try_out(straight(quadruped), quadruped.rate)
    assert door.spent.trials == 1

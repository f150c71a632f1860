"""Evolution in a displacement table that follows a robot which changes, with few generations."""

import numpy as np
import pytest

from dynreg.errors import BudgetError
from dynreg.rng import stream
from dynreg.sim.real import Budget, Spent
from dynreg.timed.evolve import Drift, HiddenWheels, evolve, judged, measured, mover_of
from dynreg.timed.goal import cells
from dynreg.timed.table import Rules
from dynreg.timed.worn import WornWheels


def test_a_hidden_robot_changes_when_its_time_comes_and_counts_its_seconds() -> None:
    robot = HiddenWheels((Drift(10, 0.5, 1.0),), scatter=(0.0, 0.0, 0.0))
    fast = np.array([399])  # both wheels at their fastest
    before = robot.move(fast)
    robot.generation = 10
    after = robot.move(fast)
    speed = cells()[0][399]
    assert before[0] == pytest.approx([0.0, 0.5 * speed, 0.0])
    assert after[0, 2] == pytest.approx(0.25 * speed / robot.track) and after[0, 1] < 0.8 * before[0, 1]
    assert robot.spent == Spent(seconds=1.0)
    robot.budget = Budget(seconds=1.0)
    with pytest.raises(BudgetError, match="1 seconds on robot 'hidden wheels' is spent"):
        robot.move(fast)
    assert robot.spent == Spent(seconds=1.0)


def test_trials_are_counted_as_they_begin_and_their_budget_is_kept() -> None:
    robot, genes = HiddenWheels(seed=2, budget=Budget(trials=8)), np.zeros(396)
    judged(robot, genes, times=4)
    assert robot.spent.trials == 8 and robot.spent.seconds == 8 * 80 * 0.5, "none of them sees the target"
    before = robot.spent
    with pytest.raises(BudgetError, match="8 trials"):
        judged(robot, genes, times=4)
    with pytest.raises(BudgetError, match="8 trials"):
        measured(robot)
    assert robot.spent == before and before.falls == 0


def test_a_table_is_measured_ten_times_for_each_command() -> None:
    robot = HiddenWheels(seed=3)
    table = measured(robot)
    count, mean, deviation = table.moments()
    assert robot.spent == Spent(400, 2000.0) and (count == 10).all()
    assert np.abs(mean - robot.truth(np.arange(400)))[:, :2].max() < 0.004
    assert np.allclose(deviation.mean(axis=0), robot.scatter, rtol=0.1)


def test_with_updates_the_table_follows_the_robot_where_it_was_driven() -> None:
    given = {"generations": 12, "every": 4, "population": 8, "seed": 2}
    ends = {}
    for update in (True, False):
        robot = HiddenWheels((Drift(5, 0.7, 1.0),), seed=5)
        found = evolve(robot, update=update, rules=Rules(apart=True), **given)
        ends[update] = found
        assert len(found.updates) == (3 if update else 0) and found.genes.shape == (396,)
        assert robot.spent.trials == (400 + 3 * 8 if update else 400)
        assert robot.spent.seconds > 2000.0 if update else robot.spent.seconds == 2000.0
    changed = ends[True].updates[1]
    visited = np.isfinite(changed.p).any(axis=1)
    assert changed.rejected[visited].any()
    after, before = ends[True].table.moments()[1], ends[False].table.moments()[1]
    truth = HiddenWheels((Drift(0, 0.7, 1.0),)).truth(np.arange(400))
    rejected = changed.rejected.any(axis=1)
    error = [np.hypot(*(m - truth)[rejected, :2].T).mean() for m in (after, before)]
    assert error[0] < 0.8 * error[1] and ends[True].error[-1] < ends[False].error[-1]
    first, last = ends[True].apart[:, ends[True].visited].mean(axis=1)
    assert last < 0.8 * first and not ends[False].visited.any()
    assert np.array_equal(*ends[False].apart) and ends[True].apart[1].mean() == ends[True].error[-1]


def test_the_same_evolution_again_and_its_trials() -> None:
    given = {"generations": 6, "every": 3, "population": 6, "method": "bits"}
    first, again = (evolve(HiddenWheels(seed=1), **given) for _ in range(2))
    assert np.array_equal(first.genes, again.genes) and np.array_equal(first.error, again.error)
    robot = HiddenWheels(seed=1)
    found = judged(robot, first.genes, times=10)
    assert found.reached.size == 20 == robot.spent.trials and robot.spent.seconds > 0


def test_a_hidden_robot_with_worn_wheels_remembers_the_command_before() -> None:
    robot = HiddenWheels(worn=WornWheels(0.7, 1.0), scatter=(0.0, 0.0, 0.0))
    told, slow, fast = np.array([210]), np.array([0]), np.array([399])
    assert np.array_equal(robot.move(told), robot.truth(told, told))
    ahead = [robot.move(told, before)[0, 1] for before in (np.array([-1]), slow, told, fast)]
    assert np.all(np.diff(ahead) > 0.002)
    drifted = HiddenWheels((Drift(0, 0.5, 0.5),), worn=WornWheels(1.0, 1.0), scatter=(0.0, 0.0, 0.0))
    assert drifted.move(told, told)[0, 1] == pytest.approx(
        0.5 * HiddenWheels(worn=WornWheels(1.0, 1.0)).truth(told)[0, 1], rel=1e-3
    )


def test_an_evolution_begins_with_the_table_that_it_is_given() -> None:
    robot, another = HiddenWheels(worn=WornWheels(0.6, 1.0), seed=4), measured(HiddenWheels(seed=5))
    given = {"generations": 9, "every": 3, "population": 8, "first": another}
    found = evolve(robot, update=False, **given)
    assert robot.spent == Spent() and found.table is another and found.error[0] == found.error[-1] > 0.004
    assert found.history.shape == (9,) and found.leaders.shape == (3, 396)
    assert found.history[-1] == found.fitness and np.array_equal(found.leaders[-1], found.genes)
    with_it = evolve(robot, **given)
    assert 0 < robot.spent.seconds <= robot.spent.trials * 40.0 == 3 * 8 * 40.0
    assert with_it.error[-1] < with_it.error[0]


def test_a_table_draws_around_its_cells_whatever_was_told_before() -> None:
    table = measured(HiddenWheels(seed=3))
    cell = np.repeat([7, 300], 4000)
    moved = mover_of(table, stream(1, "draws"))(cell, np.full(8000, -1))
    _, mean, deviation = table.moments()
    for which in (7, 300):
        own = moved[cell == which]
        assert np.allclose(own.mean(axis=0), mean[which], atol=4 * deviation[which].max() / np.sqrt(4000))
        assert np.allclose(own.std(axis=0), deviation[which], rtol=0.05)


def test_the_leader_is_the_best_of_its_generation_and_the_robot_is_told_what_came_before() -> None:
    asked = []

    class Watched(HiddenWheels):
        def move(self, cell: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
            asked.append(before)
            return super().move(cell, before)

    first = measured(HiddenWheels(seed=6))
    found = evolve(Watched(seed=4), first=first, generations=1, every=1, population=20)
    assert np.array_equal(found.leaders, found.genes[None])
    assert (asked[0] == -1).all() and all((before >= 0).all() for before in asked[1:])

"""Evolution in a displacement table that follows a robot which changes, with few generations."""

import numpy as np
import pytest

from dynreg.errors import BudgetError
from dynreg.timed.evolve import Drift, HiddenWheels, evolve, judged, measured
from dynreg.timed.goal import cells
from dynreg.timed.table import Rules


def test_a_hidden_robot_changes_when_its_time_comes_and_counts_its_steps() -> None:
    robot = HiddenWheels((Drift(10, 0.5, 1.0),), scatter=(0.0, 0.0, 0.0))
    fast = np.array([399])  # both wheels at their fastest
    before = robot.move(fast)
    robot.generation = 10
    after = robot.move(fast)
    speed = cells()[0][399]
    assert before[0] == pytest.approx([0.0, 0.5 * speed, 0.0])
    assert after[0, 2] == pytest.approx(0.25 * speed / robot.track) and after[0, 1] < 0.8 * before[0, 1]
    assert robot.steps == 2
    robot.budget = 2
    with pytest.raises(BudgetError, match="2 of 2 steps"):
        robot.move(fast)
    assert robot.steps == 2


def test_a_table_is_measured_ten_times_for_each_command() -> None:
    robot = HiddenWheels(seed=3)
    table = measured(robot)
    count, mean, deviation = table.moments()
    assert robot.steps == 4000 and (count == 10).all()
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
        assert robot.steps > 4000 if update else robot.steps == 4000
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
    assert found.reached.size == 20 and robot.steps > 0

"""Tasks: their scores on made-up walks, falls, and tasks of plugins."""

from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from dynreg.errors import RobotError, UsageError
from dynreg.gait import tasks
from dynreg.gait.tasks import LEAST, Task, fell, fitness, kinds, task_of
from dynreg.sim.gait_tables import TaskTable
from dynreg.sim.run import Walk


def walked(x: float, y: float, yaw: float = 0.0, fell_at: int = 101, first_yaw: float = 0.0) -> Walk:
    base = np.zeros((1, 1, 101, 12))
    share = np.linspace(0, 1, 101)
    base[0, 0, :, 0], base[0, 0, :, 1] = x * share, y * share
    base[0, 0, :, 5] = (first_yaw + yaw * share + np.pi) % (2 * np.pi) - np.pi  # as Euler angles come
    return Walk(base, np.array([[fell_at]]), 0)


def score(robot, name: str, walk: Walk) -> float:
    return float(fitness(task_of(robot, name).grade(walk))[0, 0])


def test_forward_is_metres_ahead_less_drift_as_the_robot_looked(quadruped) -> None:
    assert score(quadruped, "forward", walked(1.0, -0.3)) == pytest.approx(0.7)
    assert score(quadruped, "forward", walked(-1.0, 0.0)) == pytest.approx(-1.0)
    assert score(quadruped, "forward", walked(0.0, 1.0, first_yaw=np.pi / 2)) == pytest.approx(1.0)


def test_turning_counts_past_half_a_turn(quadruped) -> None:
    assert score(quadruped, "turn", walked(0.0, 0.0, yaw=4.0)) == pytest.approx(4.0)
    assert score(quadruped, "turn", walked(0.3, 0.4, yaw=1.0)) == pytest.approx(0.5)


def test_speed_is_best_where_it_is_kept(quadruped) -> None:
    assert score(quadruped, "speed", walked(1.0, 0.0)) == pytest.approx(1.0)  # 0.1 m/s for 10 s
    assert score(quadruped, "speed", walked(0.0, 0.0)) == pytest.approx(0.0)
    assert score(quadruped, "speed", walked(1.5, 0.0)) == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["forward", "turn", "speed", "slope"])
def test_a_fall_is_worth_nothing_and_graded_by_when(name: str, quadruped) -> None:
    task = task_of(quadruped, name)
    early, late, stood = (task.grade(walked(1.0, 0.0, fell_at=at)) for at in (10, 90, 101))
    assert early < late < stood
    assert fell(early) and fell(late) and not fell(stood)
    assert fitness(early) == fitness(late) == 0.0


def test_a_robot_that_stood_did_not_fall_however_low_its_score(quadruped, monkeypatch) -> None:
    task = task_of(quadruped, "forward")
    monkeypatch.setattr(type(task), "score", lambda _, base: base[:, :, -1, 0] * 1000.0)
    assert task.grade(walked(-0.4, 0.0))[0, 0] == pytest.approx(-400.0)
    low = task.grade(walked(-0.6, 0.0))
    assert low == LEAST == fitness(low) and not fell(low)
    assert fell(task.grade(walked(-0.6, 0.0, fell_at=50)))


def test_only_the_slope_is_not_level(quadruped) -> None:
    assert task_of(quadruped).slope() == 0.0
    assert task_of(quadruped, "slope").slope() == pytest.approx(0.07)


def test_unknown_tasks_kinds_and_values_are_refused(quadruped) -> None:
    with pytest.raises(UsageError, match="no task 'fly'.*'forward'"):
        task_of(quadruped, "fly")
    with pytest.raises(RobotError, match="speed = 0;"):
        tasks.Speed(TaskTable(name="a", values={"speed": 0.0}))
    with pytest.raises(RobotError, match="unknown value 'wind'"):
        tasks.Forward(TaskTable(name="a", values={"wind": 1.0}))


class Higher(Task):
    """Metres upwards."""

    kind = "higher"

    def score(self, base: np.ndarray) -> np.ndarray:
        return base[:, :, -1, 2] - base[:, :, 0, 2]


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[object], None]]:
    """Lets an installed package bring this object as a task."""
    point = EntryPoint("higher", f"{__name__}:Higher", "dynreg.tasks")

    def install(brought: object) -> None:
        monkeypatch.setattr("dynreg.plugins.entry_points", lambda group: [point])
        monkeypatch.setattr(EntryPoint, "load", lambda self: brought)
        kinds.cache_clear()

    yield install
    kinds.cache_clear()


def test_a_plugin_brings_a_task(plugin) -> None:
    plugin(Higher)
    assert kinds()["higher"] is Higher


@pytest.mark.parametrize(
    "brought, says", [(str, "is <class 'str'>"), (Task, "is <class"), (tasks.Turn, "of kind 'turn'")]
)
def test_a_plugin_that_is_no_task_of_its_own_is_refused(brought: object, says: str, plugin) -> None:
    plugin(brought)
    with pytest.raises(RobotError, match=says):
        kinds()

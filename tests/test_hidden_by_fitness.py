"""The bench that asks what a simulator made by scores hides: its robot, in MuJoCo alone, and what it counts."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynreg.methods.judged import replay_errors
from dynreg.replay.data import data
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def bench_hidden(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import bench_hidden_by_fitness

    return bench_hidden_by_fitness


def test_its_log_is_that_of_the_library_with_the_same_feet_and_not_without_them(
    bench_hidden: ModuleType,
) -> None:
    bench = bench_hidden.Bench.of("worn", 3, 1)
    plan = bench_hidden.plan_of(bench.robot)
    told = dict(list(zip(plan.names, plan.run.actions, strict=True))[:4])
    log = bench.hidden.log(told)
    cut = data(bench.robot, log, "fit_3")
    true = bench.truth
    sound = replace(true, effects={})
    nominal = SimConfig.of(bench.robot, bench.robot.space.nominal)
    same, without, plate = replay_errors(cut, [true, sound, nominal], 1)[:, 0]
    assert same < 0.6 * without and same < 0.6 * plate
    again = bench.hidden.log(told)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(log.episodes, again.episodes, strict=True))


def test_worn_feet_cost_the_robot_its_straight_way(bench_hidden: ModuleType) -> None:
    bench = bench_hidden.Bench.of("worn", 3, 1)
    played = bench_hidden.Played(bench.robot, bench_hidden.task_of(bench.robot), 3, 1)
    commands = played.commands(played.space.starts[1])
    sound = bench_hidden.PlainQuadruped(bench.robot, bench.hidden.parameters, 0.0, bench.hidden.seed)
    worn = bench.hidden.score(commands, 36.0, "a")
    assert worn is not None and worn == bench.hidden.score(commands, 36.0, "a")
    assert worn < 0.5 * sound.score(commands, 36.0, "a")


def test_the_nameplate_has_not_moved_and_what_has_is_told_in_shares_of_its_range(
    bench_hidden: ModuleType,
) -> None:
    robot = bench_hidden.Bench.of("sound", 3, 1).robot
    nominal = robot.space.as_dict(robot.space.nominal)
    assert set(bench_hidden.moved(robot, nominal).values()) == {0.0}
    reach = next(p.high - p.low for p in robot.space.parameters if p.name == "gravity")
    far = bench_hidden.moved(robot, nominal | {"gravity": nominal["gravity"] + 0.1 * reach})
    assert far["gravity"] == pytest.approx(0.1) and sum(map(abs, far.values())) == pytest.approx(0.1)


def test_the_robot_that_recordings_are_of_is_that_of_the_naming_bench(bench_hidden: ModuleType) -> None:
    from measured_quadruped import measured

    robot, other = bench_hidden.measured_quadruped(), measured(load_robot("quadruped"))
    assert robot.space.parameters == other.space.parameters and robot.file.channels == other.file.channels

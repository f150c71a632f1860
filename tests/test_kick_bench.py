"""The kick of paper B in small: 25 genes, 30 points, what counts as solved, and a kick that is found again."""

from dataclasses import replace

import aibo
import bench_kick
import kicking
import pytest
from bench_kick import ORDER, RULES, Bench
from kick_points import RUNS, SOLVED, both, goals_of, points_of, reached, show
from kicking import SHAPE, goal_of

from dynreg.gait.space import gait_space
from dynreg.sim.robot import Robot

# A ball at 45 degrees goes there: found for another hidden robot, in the unit cube.
KICK = [0.659, 0.066, 0.106, 0.32, 0.124, 0.568, 0.557, 0.003, 0.309, 0.548, 0.355, 0.817, 0.989]
KICK += [0.074, 0.677, 0.02, 0.28, 0.479, 0.723, 0.202, 0.716, 0.122, 0.263, 0.569, 0.845]


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return kicking.with_ball(tmp_path_factory.mktemp("kick") / "aibo")


def test_it_has_the_paper_s_genes_points_and_shares(dog: Robot) -> None:
    assert len(gait_space(dog, "kick")) == 25 and len(dog.space) == 38
    assert len({*ORDER}) == len(kicking.points()) == 30
    assert {goal_of(at) for at in ORDER} == {*kicking.points()}
    assert bench_kick.HANDED == 0.8 * RULES.gaits and RULES.goal == SOLVED


def test_only_the_third_run_refines_on_the_robot_and_it_seeks_for_longer(dog: Robot) -> None:
    bench = Bench(aibo.Hidden(5, dog.space.as_dict(dog.space.nominal), material=False), dog, RULES, 1)
    first, second, third = map(bench.sizes, RUNS)
    assert (first.near, second.near, third.near) == (1, 2, 2)
    assert first.steps == second.steps == 0 < third.steps
    assert third.first == 2 * second.first and third.iterations == second.iterations == 1


def line(*again: float) -> dict:
    return {"again": list(again), "unit": [0.25] * 25}


@pytest.mark.parametrize(
    ("again", "solved"),
    [((0.11, 0.12, 0.13), True), ((0.3, 0.3, 0.0), False), ((0.05, 0.09, 0.12), False), ((), False)],
)
def test_a_point_is_solved_by_new_trials_that_all_stand_and_reach_it_in_the_mean(
    again: tuple, solved: bool
) -> None:
    assert reached(line(*again)) is solved
    grid = goals_of({(0, 1, 2): line(*again), (1, 1, 1): line(0.2, 0.2, 0.2)})
    assert grid.solved.sum() == 1 + solved and grid.solved[0, 1, 2] == solved
    assert grid.filled().solved.all()


def test_points_are_counted_and_told(capsys) -> None:
    cost = {"trials": 4, "falls": 1, "rollouts": 10, "core seconds": 1.0}
    tried = [(1, 0.2, [0.1, 0.2, 0.0]), (1, 0.2, [0.3, None]), (2, 0.2, [0.09]), (2, None, [0.3])]
    made = [("start", None, None), ("adapted", 0.4, 0.1)]
    told = {"robot": 1, "step": "point", "tried": tried, "versions": made, **cost}
    rows = [told | {"at": at} | line(*[0.01 * i] * 3) for i, at in enumerate(ORDER)]
    show(rows)
    text = capsys.readouterr().out
    assert "30 points, 120 trials, 30 of them falls" in text
    assert "solved: 20 by 0.1 m, 10 by 0.2 m, 0 by 0.3 m" in text
    assert "all: 90 kicks tried, 33% score half of what the simulator said" in text
    assert "first run, iteration 1: 60 kicks tried, 50%" in text and "iteration 2: 30 kicks tried, 0%" in text
    assert "30 adaptations: 25% of the difference is left in the median" in text


def test_a_second_run_counts_both_costs_and_keeps_the_better_kick() -> None:
    cost = {"trials": 4, "falls": 1, "rollouts": 10, "core seconds": 1.0}
    first, good, bad = (line(*again) | cost for again in ((0.05,) * 3, (0.2,) * 3, (0.9, 0.9, 0.0)))
    assert both(first, good)["again"] == good["again"] and both(good, first)["again"] == good["again"]
    assert both(good, bad)["again"] == good["again"], "one that falls is not solved"
    assert both(first, good)["trials"] == 8 and both(first, good)["rollouts"] == 20
    rows = [
        {"robot": 1, "at": [0, 1, 2], "step": step} | one
        for step, one in (("point", first), ("second", good))
    ]
    assert points_of(rows, 1) == {(0, 1, 2): both(*rows)} and points_of(rows, 2) == {}
    third = {"robot": 1, "at": [0, 1, 2], "step": "third"} | line(0.3, 0.3, 0.3) | cost
    assert points_of([*rows, third], 1)[0, 1, 2]["trials"] == 12
    assert points_of([*rows, third], 1)[0, 1, 2]["again"] == third["again"]


def test_a_kick_that_a_point_beside_it_found_is_found_again(dog: Robot, monkeypatch) -> None:
    """The hidden robot is the nominal one."""
    monkeypatch.setattr(bench_kick, "DRAWS", 4)
    monkeypatch.setattr("reality_runs.FINER", 1)
    nominal = aibo.Hidden(5, dog.space.as_dict(dog.space.nominal), material=False)
    bench, start = (
        Bench(nominal, dog, replace(RULES, first=1, iterations=1, stand=1), 1),
        dog.space.to_unit(dog.space.nominal),
    )
    handed = [[KICK] for _ in range(SHAPE[2])]
    found = bench.point((0, 1, 1), {(0, 1, 0): {"handed": handed}}, start)
    assert found["ended"] == "goal" and found["trials"] == RULES.repeats and found["falls"] == 0
    assert reached(found) and found["rollouts"] == 4 + 1 + RULES.gaits
    assert found["score"] == pytest.approx(found["simulated"], abs=0.08)


def test_a_third_run_tries_first_what_the_point_had_before(dog: Robot, monkeypatch) -> None:
    monkeypatch.setattr(bench_kick, "DRAWS", 2)
    monkeypatch.setattr("reality_runs.FINER", 1)
    nominal = aibo.Hidden(5, dog.space.as_dict(dog.space.nominal), material=False)
    bench = Bench(nominal, dog, replace(RULES, first=1, stand=2), 1)
    before = {(0, 1, 1): {"handed": [[] for _ in range(SHAPE[2])], "unit": KICK}}
    found = bench.point((0, 1, 1), before, dog.space.to_unit(dog.space.nominal), "third")
    (_, simulated, scores), *_ = found["tried"]
    assert simulated is None and min(scores) >= SOLVED and found["ended"] == "goal"
    assert found["rollouts"] == 3 * 2 + 2 * RULES.gaits, "draws, and a generation in two simulators"

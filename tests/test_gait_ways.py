"""Ways to make the simulators of a gait's search: what they make of a log, and the table that judges them."""

from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import load_robot

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
SEED = 61  # of the development


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import bench_gait_ways

    return bench_gait_ways


@pytest.fixture
def sources(bench: ModuleType) -> ModuleType:
    import gait_sources

    return gait_sources


SPACE = load_robot("quadruped").space


def told() -> dict:
    """What a query tells: an answer, five neighbours, and draws for two searches."""
    made = SPACE.from_unit(np.full(len(SPACE), 0.5))
    near = SPACE.sample(0, 5, SEED)
    posterior = [np.concatenate([made[None], SPACE.sample(0, 6, SEED + i)]).tolist() for i in (1, 2)]
    spent = {"trials": 20, "seconds": 27.0, "falls": 5}
    return {
        "synthesised": [made.tolist()],
        "nearest": near.tolist(),
        "posterior": posterior,
        "spent": spent,
        "truth": 1.1,
    }


def test_noisy_neighbours_have_the_answers_noise_and_their_own_bodies(sources) -> None:
    walker, step = SimpleNamespace(robot=SimpleNamespace(space=SPACE), seed=SEED), told()
    plain, noisy = (sources.simulators(None, walker, s, step).values for s in ("nearest", "noisy"))
    noise = SPACE.names.index("motor_noise")
    assert (noisy[:, noise] == step["synthesised"][0][noise]).all() and len({*plain[:, noise]}) == 5
    assert np.array_equal(np.delete(plain, noise, axis=1), np.delete(noisy, noise, axis=1))
    first, again, other = (
        sources.simulators(None, walker, "posterior", step, number).values for number in (0, 0, 1)
    )
    assert np.array_equal(first, again) and not np.array_equal(first[1:], other[1:])


def test_a_hand_finds_the_friction_and_the_motors_that_were_planted(bench) -> None:
    import hand_tuned

    robot, space = load_robot("quadruped"), SPACE
    planted = space.from_dict(space.as_dict(space.nominal) | {"torque": 0.9, "friction": 0.45})
    commands = excitation(robot, seed=3, name="hand").actions[:4]
    real = SimulatedRobot(robot, planted, seed=3, threads=1)
    log = real.run(np.concatenate(commands), robot.rate, "hand").recording
    found = hand_tuned.hand_tuned(robot, log)
    assert len(found.errors) == 25 and min(found.errors) < 0.7 * found.errors[0]
    untouched = [i for i, name in enumerate(space.names) if name not in (*hand_tuned.TUNED, "action_rate")]
    assert found.values[untouched] == pytest.approx(space.nominal[untouched])


def test_the_first_search_of_a_way_is_that_of_the_other_table_and_the_second_is_not(
    bench, tmp_path, monkeypatch
) -> None:
    """With 21 rollouts, in a simulator that a journal holds already."""
    import bench_gait_hidden as hidden

    monkeypatch.setattr("gait_tried.TRIALS", 1)
    plan = hidden.Plan(SEED, 12, 21, 60)
    journal = hidden.Cells(tmp_path / "ways.jsonl", plan)
    journal.begin()
    journal.keep("family 0", "query", told())
    steps = tuple(bench.step_of("synthesised", number) for number in (0, 1))
    bench.work(hidden.Job(plan, "family 0", steps, journal.path, "", ""))
    hidden.work(hidden.Job(plan, "family 0", ("synthesised",), journal.path, "", ""))
    done = journal.steps()
    first, second, other = (done["family 0", step] for step in (*steps, "synthesised"))
    assert first["genes"] == other["genes"] and first["trials"] == other["trials"]
    assert first["genes"] != second["genes"] and first["gaits"] == second["gaits"]


def test_all_ways_have_the_same_rollouts_or_the_same_gaits(bench, monkeypatch) -> None:
    walker, asked = bench.walker_of("family 0", SEED), []
    monkeypatch.setattr(
        bench, "searched", lambda walker, trials, real, settings: asked.append(settings) or {}
    )
    job = SimpleNamespace(plan=bench.Plan(SEED, 12, 2000, 60))
    ways = {"posterior": 7, "posterior min": 7, "synthesised": 1, "synthesised gaits": 1, "pulled mean": 5}
    step = told() | {"pulled": told()["nearest"]}
    for way, many in ways.items():
        assert bench.cell(job, walker, bench.WAYS[way], 0, step)["simulators"] == many
    assert [(s.rollouts, s.accept) for s in asked] == [
        (2000, "mean"),
        (2000, "min"),
        (2000, "min"),
        (500, "min"),
        (2000, "mean"),
    ]
    gaits = [s.evaluations(many) for s, many in zip(asked, ways.values(), strict=True)]
    assert gaits[0] == gaits[1] == pytest.approx(gaits[3], rel=0.05) and gaits[2] == pytest.approx(
        1600, rel=0.01
    )
    assert len({s.seed for s in asked}) == 1
    assert [s.packaged for s in asked] == [False] * 5
    bench.cell(job, walker, bench.WAYS["posterior packaged"], 0, step)
    assert asked[-1].packaged and asked[-1].meets == asked[0].meets


def test_ways_are_held_against_the_default_robot_by_robot(bench, capsys) -> None:
    steps, hard = {("family 0", "query"): {}}, np.random.default_rng(3).uniform(1.0, 4.0, 12)
    for i, own in enumerate(hard):  # robots differ more than ways do
        for way, gain in {"posterior": 0.0, "synthesised": 0.5, "noisy": 0.1 * (-1) ** i}.items():
            for number in range(2):
                real = own + gain + 0.2 * (number - 0.5)
                cell = {"real": real, "success": real >= 2.0, "fell": number, "gaits": 600, "core": 26.0}
                steps[f"family {i}", bench.step_of(way, number)] = cell
    rows = bench.table(steps, seconds=10.0)
    assert rows["synthesised"]["difference"] == pytest.approx([5.0, 5.0, 5.0])
    assert rows["synthesised"]["p"] < 0.01
    value, low, high = rows["noisy"]["difference"]
    assert low < value < high and rows["noisy"]["p"] > 0.3 and "p" not in rows["posterior"]
    assert rows["synthesised"]["speed"][0] == pytest.approx(10.0 * (hard.mean() + 0.5))
    assert rows["noisy"]["falls"] == 12 and rows["noisy"]["searches"] == 24
    bench.show(rows)
    assert "5.00 [  5.00,   5.00]" in capsys.readouterr().out

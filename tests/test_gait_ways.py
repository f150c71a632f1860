"""Ways to make the simulators of a gait's search: what they make of a log, and the table that judges them."""

from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from dynreg.evidence.gaussian import Gaussian
from dynreg.sim.excitation import excitation
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import load_robot
from dynreg.verbs.posteriors import posterior_told

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
FREE = ("torque", "torso_mass", "gravity")


def told(untold: tuple[str, ...] = ("gravity",)) -> dict:
    """What a query tells of three parameters: mass and torque go together, and gravity makes up for the mass."""
    own = [SPACE.parameters[SPACE.names.index(name)] for name in FREE]
    correlations = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, -0.6], [0.0, -0.6, 1.0]])
    found = Gaussian(
        FREE,
        tuple(p.scale for p in own),
        np.array([[p.low, p.high] for p in own]),
        np.full(3, 0.5),
        np.array([0.02, 0.05, 0.3]),
        correlations,
        untold,
    )
    made = SPACE.from_unit(np.full(len(SPACE), 0.5))
    near = SPACE.sample(0, 5, SEED)
    posterior = {"made": made.tolist(), "told": posterior_told(found).model_dump(mode="json")}
    spent = {"trials": 20, "seconds": 27.0, "falls": 5}
    return {"synthesised": [made.tolist()], "nearest": near.tolist(), "posterior": posterior, "spent": spent}


def test_a_posterior_moves_what_the_log_told_together_and_leaves_the_rest(sources) -> None:
    step = told()
    values = sources.drawn(SPACE, step, 4000, np.random.default_rng(1))
    assert np.array_equal(values[0], step["synthesised"][0])
    moved = SPACE.to_unit(values[1:]) - 0.5
    torque, mass = (SPACE.names.index(name) for name in FREE[:2])
    still = [i for i in range(len(SPACE)) if i not in (torque, mass)]
    assert moved[:, still] == pytest.approx(0.0, abs=1e-9)
    # with gravity given, the mass is known better: 0.05 sqrt(1 - 0.6^2)
    assert moved[:, torque].std() == pytest.approx(0.02, rel=0.05)
    assert moved[:, mass].std() == pytest.approx(0.04, rel=0.05)
    assert np.corrcoef(moved[:, torque], moved[:, mass])[0, 1] == pytest.approx(1.0, abs=1e-3)


def test_a_log_that_told_nothing_leaves_one_simulator(sources) -> None:
    for step in (told(FREE), told() | {"posterior": None}):
        assert len(sources.drawn(SPACE, step, 4, np.random.default_rng(1))) == 1


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

    monkeypatch.setattr(hidden, "TRIALS", 1)
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


def test_equal_gaits_are_as_many_rollouts_in_each_simulator(bench, monkeypatch) -> None:
    walker, asked = bench.walker_of("family 0", SEED), []
    monkeypatch.setattr(
        bench, "searched", lambda walker, trials, real, settings: asked.append(settings) or {}
    )
    job = SimpleNamespace(plan=bench.Plan(SEED, 12, 100, 60))
    for way in ("posterior", "posterior gaits", "posterior quartile"):
        assert bench.cell(job, walker, bench.WAYS[way], 0, told())["simulators"] == 5
    assert [(s.rollouts, s.accept) for s in asked] == [(100, "min"), (500, "min"), (100, "quantile")]
    assert len({s.seed for s in asked}) == 1


def test_ways_are_held_against_the_answer_robot_by_robot(bench, capsys) -> None:
    steps, hard = {("family 0", "query"): {}}, np.random.default_rng(3).uniform(1.0, 4.0, 12)
    for i, own in enumerate(hard):  # robots differ more than ways do
        for way, gain in {"synthesised": 0.0, "posterior": 0.5, "noisy": 0.1 * (-1) ** i}.items():
            for number in range(2):
                real = own + gain + 0.2 * (number - 0.5)
                cell = {"real": real, "success": real >= 2.0, "fell": number, "gaits": 600, "core": 26.0}
                steps[f"family {i}", bench.step_of(way, number)] = cell
    rows = bench.table(steps, seconds=10.0)
    assert rows["posterior"]["difference"] == pytest.approx([5.0, 5.0, 5.0]) and rows["posterior"]["p"] < 0.01
    value, low, high = rows["noisy"]["difference"]
    assert low < value < high and rows["noisy"]["p"] > 0.3 and "p" not in rows["synthesised"]
    assert rows["posterior"]["speed"][0] == pytest.approx(10.0 * (hard.mean() + 0.5))
    assert rows["noisy"]["falls"] == 12 and rows["noisy"]["searches"] == 24
    bench.show(rows)
    assert "5.00 [  5.00,   5.00]" in capsys.readouterr().out

"""The table of gaits for hidden quadrupeds: its robots, its journal, its figures."""

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynreg.sim.real import BudgetError

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
SEED = 61  # of the development


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import bench_gait_hidden

    return bench_gait_hidden


@pytest.fixture
def walkers(bench: ModuleType) -> ModuleType:
    import walkers

    return walkers


def test_two_robots_of_each_kind_outside_and_as_many_inside(walkers) -> None:
    names = walkers.names(12)
    assert len({*names}) == 24
    kinds = [name.rpartition(" ")[0] for name in names]
    assert kinds.count("family") == 12
    assert {kinds.count(k) for k in walkers.COMMON} == {2}
    assert kinds.count("soft ground") == kinds.count("slippery side") == 1
    assert walkers.names(3) == names[:6]  # a smaller table is the beginning of a larger one


def test_a_robot_is_the_same_again_and_hides_what_its_kind_says(walkers) -> None:
    first, again = (walkers.walker_of("weak joint 1", SEED) for _ in range(2))
    assert np.array_equal(first.parameters, again.parameters) and first.seed == again.seed
    assert not np.array_equal(walkers.walker_of("weak joint 6", SEED).parameters, first.parameters)
    (term,) = first.effects.terms
    assert term.effect.id == "torque_limit" and len(term.joints) == 1
    space = first.robot.space
    low, high = space.bounds.T
    assert ((low <= first.parameters) & (first.parameters <= high)).all()
    assert space.as_dict(first.parameters)["action_rate"] == walkers.RATE
    told = first.nameplate / first.parameters
    assert told[space.names.index("gravity")] == pytest.approx(1.0, abs=3e-3)
    assert not np.array_equal(first.nameplate, first.parameters)
    assert first.task.slope() == 0.0 and first.truth.terms is first.effects


def test_a_slope_is_the_ground_of_the_oracle_and_of_the_robot(walkers) -> None:
    hill = walkers.walker_of("slope 3", SEED)
    assert hill.effects is None
    assert hill.task.slope() == hill.real(None).slope == pytest.approx(np.radians(4.0))


def test_a_trial_beyond_what_a_source_may_cost_is_refused(walkers) -> None:
    from dynreg.sim.real import Budget, Spent

    real = walkers.walker_of("family 0", SEED).real(Budget(trials=21), Spent(21, 30.0, 0))
    with pytest.raises(BudgetError):
        real.run(np.zeros((3, 12)), 36.0)


@pytest.fixture
def journal(bench, tmp_path: Path):
    made = bench.Cells(tmp_path / "sub" / "table.jsonl", bench.Plan(SEED, 1, 21, 60))
    made.begin()
    return made


def test_a_journal_goes_on_and_leaves_out_a_torn_line(bench, journal) -> None:
    journal.keep("family 0", "nominal", {"real": 0.1})
    with open(journal.path, "a") as file:
        file.write('{"robot": "family 0", "step": "tr')
    again = bench.Cells(journal.path, bench.Plan(SEED, 1, 21, 60))
    again.begin()
    again.keep("family 0", "true", {"real": 0.2})
    assert {key: line["real"] for key, line in again.steps().items()} == {
        ("family 0", "nominal"): 0.1,
        ("family 0", "true"): 0.2,
    }
    with pytest.raises(SystemExit, match="another table"):
        bench.Cells(journal.path, bench.Plan(SEED, 2, 20, 60)).begin()
    assert len(again.steps()) == 2


def test_finished_cells_are_not_run_again(bench, journal, monkeypatch) -> None:
    """With 21 rollouts (two batches), on one robot; nothing of a population is needed for these sources."""
    monkeypatch.setattr("gait_tried.TRIALS", 1)
    monkeypatch.setattr(bench, "ORACLES", 3)
    job = bench.Job(journal_plan(bench), "family 0", ("nominal", "true"), journal.path, "", "")
    assert bench.work(job) == "family 0"
    cells = journal.steps()
    for source in job.sources:
        cell = cells["family 0", source]
        assert cell["gaits"] == 20 and cell["spent"]["trials"] == 0
        assert cell["success"] == (not cell["fell"] and cell["real"] >= 0.3)
        assert cell["real"] == pytest.approx(np.mean(cell["trials"])) and len(cell["trials"]) == 1
        assert sorted(cell["all"])[len(cell["all"]) // 2] == cell["real"]  # of the oracles the middle one
        assert len(cell["all"]) == {"nominal": 1, "true": 3}[source]
    before = journal.path.read_bytes()
    monkeypatch.setattr(bench, "searched", None)
    bench.work(job)
    assert journal.path.read_bytes() == before


def journal_plan(bench):
    return bench.Plan(SEED, 1, 21, 60)


def test_robots_that_hide_nothing_tell_what_scores_chance_reaches(bench, walkers, journal, monkeypatch):
    asked = []

    def named(walker, log, needed, effects):
        asked.append((walker.kind, walker.effects, needed))
        return walkers.Named("none", (13.5, 2.0), (), walker.truth, walker.truth)

    monkeypatch.setattr(bench, "stood_and_trotted", lambda walker: (None, None))
    monkeypatch.setattr(bench, "named", named)
    job = bench.Job(journal_plan(bench), "null 0", (), journal.path, "", "")
    assert bench.null(job) == "null 0"
    assert journal.steps()["null 0", "null"]["nats"] == 13.5
    assert asked == [("null", None, np.inf)]  # no cause may be taken: the first round alone counts


def made_up(bench, many: int = 4) -> tuple[dict, list[str]]:
    """Steps of a table in which the diagnosed simulator walks 2 cm/s faster than the nearest ones."""
    metres = {"nearest": 0.2, "synthesised": 0.25, "diagnosed": 0.4, "calibrated": 0.3, "true": 0.5}
    names = bench.names(many)
    steps = {}
    for i, name in enumerate(names):
        for source, real in metres.items():
            real = real + 0.01 * (i % 3)
            spent = {"trials": 11, "seconds": 26.7, "falls": 0}
            cell = {"real": real, "fell": False, "success": real >= 0.3, "spent": spent, "core": 3.0}
            steps[name, source] = json.loads(json.dumps(cell))
        steps[name, "naming"] = {"causes": ["payload"]} if i else {"problem": "it fell"}
    return steps, names


def test_the_table_has_shares_gains_and_intervals(bench, capsys) -> None:
    steps, names = made_up(bench)
    out = bench.table(steps, names, seconds=10.0)
    assert {half: found["robots"] for half, found in out.items()} == {"in the family": 4, "outside": 4}
    outside = out["outside"]
    assert {s: row["success"]["hits"] for s, row in outside["sources"].items()} == {
        "nearest": 0,
        "synthesised": 0,
        "diagnosed": 4,
        "calibrated": 4,
        "true": 4,
    }
    gain = outside["gains"]["diagnosed - nearest"]
    assert gain["value"] == pytest.approx(2.0) and gain["low"] == pytest.approx(2.0)  # paired robot by robot
    share = outside["sources"]["diagnosed"]["share"]
    assert 0.7 < share["low"] <= share["value"] <= share["high"] < 0.9
    assert outside["sources"]["true"]["share"]["value"] == 1.0
    bench.show(out)
    told = capsys.readouterr().out
    assert "diagnosed - nearest:  2.00 [ 2.00,  2.00] cm/s" in told and "it fell" in told


def test_robots_with_cells_that_are_left_do_not_count(bench) -> None:
    steps, names = made_up(bench)
    del steps[names[1], "nearest"]
    out = bench.table(steps, names, seconds=10.0)
    assert out["outside"]["robots"] == 3 and out["in the family"]["robots"] == 4
    assert bench.table({}, names, seconds=10.0) == {}


def test_an_oracle_that_does_not_walk_has_no_share(bench) -> None:
    steps, names = made_up(bench, 1)
    for cell in (steps[name, "true"] for name in names):
        cell["real"] = 0.0
    out = bench.table(steps, names, seconds=10.0)
    assert out["outside"]["sources"]["nearest"]["share"] == {"value": None, "low": None, "high": None}
    bench.show(out)


def test_trials_in_turn_are_told_beside_their_first_gait_and_the_luckiest(bench) -> None:
    spent = {"trials": 23, "seconds": 56.0, "falls": 0}
    names, steps = [f"family {i}" for i in range(4)], {}
    # what each gait reached in its trial, whether it fell, what it does; which one is the best
    made = (
        ([(1.0, False, 2.0), (3.0, False, 1.0), (0.0, True, 4.0)], 3),
        ([(0.0, True, 0.0), (0.0, True, 1.0)], 2),
        ([(0.0, True, 3.0), (-0.1, False, 2.0)], 1),
        ([], 0),  # no simulator is close enough
    )
    for name, (rounds, best) in zip(names, made, strict=True):
        tried = [{"real": does, "fell": 0, "success": True} for *_, does in rounds]
        told = [{"real": r, "fell": f, "tried": t} for (r, f, _), t in zip(rounds, tried, strict=True)]
        first = {"first": tried[0], "rounds": told, "best": best, **tried[best - 1]} if rounds else {}
        nothing = {"real": 0.0, "fell": 0, "success": False}
        steps[name, "rounds"] = nothing | first | {"spent": spent, "core": 1.0}
    out = bench.table(steps, names, seconds=10.0)["in the family"]
    speed = {source: row["speed"]["value"] for source, row in out["sources"].items()}
    assert speed == pytest.approx({"first": 12.5, "rounds": 20.0, "luckiest": 10.0})
    gains = {name: (gain["better"], gain["the same gait"]) for name, gain in out["gains"].items()}
    assert gains == {"rounds - their first gait": (2, 1), "luckiest - their first gait": (1, 0)}
    del steps["family 0", "rounds"]["rounds"][0]["tried"]  # a journal of an older loop
    assert "luckiest" not in bench.table(steps, names, seconds=10.0)["in the family"]["sources"]


def test_a_diagnosis_that_could_not_be_made_walks_nowhere(bench, journal, monkeypatch) -> None:
    walker = bench.walker_of("family 0", SEED)
    spent = {"trials": 10, "seconds": 9.0, "falls": 10}
    job = bench.Job(journal_plan(bench), walker.name, (), journal.path, "", "")
    cell = bench._cell(job, walker, "diagnosed", {"spent": spent, "problem": "too short"})
    assert not cell["success"] and cell["spent"] == spent and cell["problem"] == "too short"

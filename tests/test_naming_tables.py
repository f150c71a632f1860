"""Tables of the naming benchmarks: counts that add up, and the documentation shows the figures that were written."""

import json
from pathlib import Path
from types import ModuleType

import made_up_diagnosis
import pytest

from dynreg.diagnose.threshold import Threshold
from dynreg.errors import UsageError

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def naming(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import naming

    return naming


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    import naming_table

    return naming_table


def made_up(naming: ModuleType) -> dict:
    """The tables of made-up trials, half of whose right names have an interval that holds the truth."""
    trials = [
        t.model_copy(update={"covered": t.seed % 2 == 0, "core_seconds": 1.0 + t.seed})
        if t.parameter_error is not None
        else t
        for t in made_up_diagnosis.trials().trials
    ]
    return json.loads(json.dumps(naming.document("servo_pendulum", trials, Threshold(12.5, ()))))


def test_the_page_shows_the_figures_that_were_written(tables):
    page = tables.PAGE.read_text()
    assert "servo_pendulum" in [robot for _, robot, _ in tables.BLOCK.findall(page)]
    assert tables.filled(page, tables.documents()) == page, "run `python benchmarks/naming_table.py`"


def test_a_page_that_is_out_of_date_is_made_anew_and_the_rest_stays(tables):
    found = tables.documents()
    page = "before\n<!-- naming: servo_pendulum -->\n| old |\n<!-- /naming -->\nafter\n"
    new = tables.filled(page, found)
    assert new.startswith("before\n<!-- naming") and new.endswith("<!-- /naming -->\nafter\n")
    assert "| old |" not in new and tables.markdown(found["servo_pendulum"]) in new


def test_a_mark_without_figures_is_refused(tables):
    with pytest.raises(UsageError, match="no naming figures of 'walker'"):
        tables.filled("<!-- naming: walker -->\n<!-- /naming -->\n", {})


def test_the_robots_of_one_file_are_told_apart(tables, tmp_path):
    (tmp_path / "naming_leg.json").write_text(
        json.dumps({w: {"robot": f"leg, {w}"} for w in ("air", "ground")})
    )
    (tmp_path / "naming.json").write_text(json.dumps({"robot": "servo"}))
    assert set(tables.documents(tmp_path)) == {"servo", "leg, air", "leg, ground"}


def test_tables_hold_every_trial_and_none_of_them_whole(naming):
    out = made_up(naming)
    assert "trials" not in out and out["right"]["hits"] == 8
    assert out["effects"]["load_friction"]["sizes"] == {"medium": [4, 5]}
    assert out["matrix"] == {
        "load_friction": {"load_friction": 4, "stribeck_friction": 1},
        "backlash": {"backlash": 4, "nothing": 1},
        "nothing": {"nothing": 3, "payload": 1},
    }
    held = [e["covered"] for e in out["effects"].values()]
    assert sum(c["hits"] for c in held) == out["covered"]["hits"] < out["covered"]["of"]
    assert out["seconds"]["core"]["median"] <= out["seconds"]["core"]["p95"] <= 15.0


def test_rows_say_what_the_tables_say(naming, tables):
    rows = tables.markdown(made_up(naming)).splitlines()
    assert "| load_friction |  | 4/5 |  | 6 % | 2/4 | stribeck_friction (1) |" in rows
    assert any(r.startswith("| backlash |  | 4/5 |") and r.endswith("| nothing (1) |") for r in rows)
    assert rows[-1].startswith("| **all** |  | 8/10 |  |")


def test_names_given_though_the_cause_was_taken_away_and_causes_missed_are_told(naming, capsys):
    sure = made_up_diagnosis.trial(0, "load_friction", "payload")
    unsure = sure.model_copy(update={"verdict": "partly_explained"})
    assert naming.report_absent([sure, unsure]) == {
        "wrong": 1,
        "of": 2,
        "names": ["load_friction -> payload"],
    }
    both = sure.model_copy(update={"hidden": "backlash+payload", "causes": ("payload",)})
    pairs = naming.report_pairs([both, both.model_copy(update={"right": True})])
    assert (pairs["hits"], pairs["missed"]) == (1, ["backlash+payload (medium) -> named, payload"])
    assert naming.report_pairs([]) is None and naming.report_absent([]) is None
    assert "cause absent: confident wrong names 1 of 2" in capsys.readouterr().out


@pytest.mark.parametrize(("many", "lines"), [(3, 3), (120, 2)])
def test_a_few_trials_are_told_one_by_one_and_many_by_fifties(naming, monkeypatch, capsys, many, lines):
    named = {0: "load_friction", 1: None, 2: "payload"}
    monkeypatch.setattr(
        naming, "run", lambda job: made_up_diagnosis.trial(job.seed, named=named[job.seed % 3])
    )
    jobs = [naming.Job(None, None, ("load_friction",), "medium", i, Threshold(5.0, ())) for i in range(many)]
    assert [r.seed for r in naming.run_all(jobs, 1)] == list(range(many))
    told = capsys.readouterr().out.splitlines()
    assert len(told) == lines
    if many == 3:
        assert [line.split(":")[0].strip() for line in told] == ["right", "missed", "WRONG"]
    else:
        assert told[-1] == "100 of 120 done: right 34, wrong 33"


def test_trials_in_the_journal_are_not_run_again(naming, monkeypatch, tmp_path):
    ran = []

    def run(job):
        ran.append(job.seed)
        if len(ran) == 3:
            raise KeyboardInterrupt
        return made_up_diagnosis.trial(job.seed, named="load_friction")

    monkeypatch.setattr(naming, "run", run)
    jobs = [naming.Job(None, None, ("load_friction",), "medium", i, Threshold(5.0, ())) for i in range(4)]
    journal = naming.Journal(tmp_path / "trials.jsonl", {"seed": 5})
    journal.begin()
    with pytest.raises(KeyboardInterrupt):
        naming.run_all(jobs, 1, journal)
    journal.path.write_text(journal.path.read_text() + '{"trial": "torn')
    journal.begin()
    done = naming.run_all(jobs, 1, journal)
    assert [r.seed for r in done] == [0, 1, 2, 3]
    assert ran == [0, 1, 2, 2, 3]
    assert naming.run_all(jobs, 1, journal) == done and len(ran) == 5
    with pytest.raises(SystemExit, match="another table"):
        naming.Journal(journal.path, {"seed": 6}).begin()


def test_the_bench_of_independent_robots_gives_every_cause_its_turn(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import bench_naming_independent as bench

    from dynreg.evidence.truth import protocol
    from dynreg.sim.robot import load_robot

    robot = load_robot("diffdrive")
    one = bench.Job(
        robot, protocol(robot, seconds=12.5), (), None, 0, Threshold(20.0, ()), truth="independent"
    )
    rows = bench.rows_of(robot)
    assert "encoder_scale" not in rows.same and rows.outside == ("eccentric_wheel", "coloured_speed")
    mine = bench.hidden(one, "same", rows.same, 2 * len(rows.same), 1)
    assert sorted(job.keys[0] for job in mine) == sorted(2 * rows.same)
    assert {job.size for job in mine} == {"medium", "strong"} and len({job.seed for job in mine}) == len(mine)
    others = bench.hidden(one, "same", rows.same, 4, bench.REPORT["diffdrive"])
    assert not {job.seed for job in mine} & {job.seed for job in others}, "tuned robots never report"

"""`dynreg drift`: what it passes on, what it prints, what it refuses, and its page."""

import json
import re
from pathlib import Path

import made_up_drift
import made_up_results
import pytest

from dynreg.cli.schemas import model_of
from dynreg.errors import NoMatchError
from dynreg.report.drift import again
from dynreg.results import Drift
from dynreg.verbs.drift import DriftSettings


@pytest.fixture
def asked(session):
    session.answers |= {"drift": made_up_drift.drift()}
    return session


def test_drift_passes_its_options_on(dynreg, asked) -> None:
    line = "drift friday --against monday --sample 0.25 --cells 10 --level 0.01 --welch --no-fdr --splits 50"
    more = "--seed 4 --robot diffdrive --map m.toml --out table.parquet"
    ended = dynreg(*line.split(), *more.split())
    assert ended.status == 0 and "table.parquet: written" in ended.err
    assert asked.asked == [
        (
            "drift",
            ("friday", "monday"),
            {
                "sample": 0.25,
                "cells": 10,
                "level": 0.01,
                "welch": True,
                "together": False,
                "splits": 50,
                "effects": None,
                "threshold_runs": 20,
                "tolerance": 1.0,
                "horizon": None,
                "windows": None,
                "threads": 0,
                "seed": 4,
                "out": Path("table.parquet"),
                "robot": "diffdrive",
                "log_map": Path("m.toml"),
                "progress": asked.asked[0][2]["progress"],
            },
        )
    ]
    assert dynreg("drift", "friday").status == 0
    verb, given, named = asked.asked[1]
    assert given == ("friday", None) and named["together"] and not named["welch"] and named["out"] is None


def test_drift_answers_in_json_and_in_tables(dynreg, asked) -> None:
    document = json.loads(dynreg("drift", "friday", "--json").out)
    assert model_of(document["schema"]).model_validate(document) == asked.answers["drift"]
    ended = dynreg("drift", "friday")
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100
    for words in (
        "monday is no longer true of diffdrive in friday",
        "left wheel x 0.802 [0.799, 0.805]",
        "-6.00 +- 0.50 *",  # mm
        "230 tests each",
        "763 too short",
        "dynreg drift friday --against monday --out",
    ):
        assert words in " ".join(ended.out.split())
    # as it is stored, with its keys sorted
    asked.answers["drift"] = Drift.model_validate(json.loads(json.dumps(document, sort_keys=True)))
    assert [*asked.answers["drift"].cells[0].shifts] == ["dtheta", "dx", "dy"]
    assert dynreg("drift", "friday").out == ended.out
    assert re.search(
        r"-0.236 +\+0.173 +6, 7 +-6.00 \+- 0.50 +-6.00 \+- 0.50 \* +-6.88 \+- 0.57 \*", ended.out
    )
    asked.answers["drift"] = made_up_drift.drift(rivals=("left wheel", "all speeds"))
    ended = dynreg("drift", "friday")
    assert "which these commands cannot tell apart" in " ".join(ended.out.split())
    assert "record left +0.19, right +0.19 m/s" in ended.out and "monday has none of these" in ended.out


@pytest.mark.parametrize("line", ["drift friday", "show @last"])
def test_a_step_repeats_the_registry_that_was_asked(line: str, dynreg, asked) -> None:
    """Typed as shown it asked the usual registry, or none; also where the result is shown again."""
    stored = made_up_results.entry().model_copy(update={"kind": "result", "name": "drift"})
    asked.answers |= {"show": stored, "result": made_up_drift.drift()}
    ended = dynreg(*line.split(), "--registry", "else where")
    step = " ".join(ended.out.split()).split("dynreg drift friday --against monday --out")[1]
    assert "--registry 'else where'" in step.split(" next: ")[0]


def test_two_logs_may_be_the_first_things_in_a_registry(dynreg, asked) -> None:
    Path("monday.csv").write_text("")
    Path("friday.csv").write_text("")
    line = "drift friday.csv --against monday.csv --robot diffdrive"
    assert dynreg(*line.split()).status == 0 and asked.created
    for line in (
        "drift friday.csv --against monday.csv",
        "drift friday.csv --robot diffdrive",
        "drift friday.csv --against monday --robot diffdrive",
        "drift friday --against monday.csv --robot diffdrive",
    ):
        assert dynreg(*line.split()).status == 0 and not asked.created, line


def test_the_table_is_to_be_kept_by_the_same_tests_unless_it_was(dynreg, asked) -> None:
    usual = made_up_drift.drift()
    unusual = {"sample": 0.25, "grid": 10, "test": "welch", "together": False, "seed": 3}
    rates = usual.false_alarms.model_copy(update={"level": 0.01})
    asked.answers["drift"] = usual.model_copy(
        update=unusual | {"false_alarms": rates, "recording_name": "on friday"}
    )
    assert (
        "dynreg drift 'on friday' --against monday --sample 0.25 --cells 10 --level 0.01 --seed 3 --welch --no-fdr"
        " --out table.parquet" in " ".join(dynreg("drift", "friday").out.split())
    )
    asked.answers["drift"] = usual
    assert "dynreg drift friday --against monday --out table.parquet" in dynreg("drift", "friday").out
    asked.answers["drift"] = usual.model_copy(update={"kept": True})
    assert "--out" not in dynreg("drift", "friday", "--out", "table.parquet").out


def test_what_is_usual_in_the_hint_is_what_the_test_does_unasked() -> None:
    """A document of the test's own settings has a hint without any."""
    usual = DriftSettings()
    document = made_up_drift.drift()
    rates = document.false_alarms.model_copy(update={"level": usual.level})
    own = {"sample": usual.sample, "grid": usual.cells, "seed": usual.seed, "together": usual.together}
    made = document.model_copy(update=own | {"false_alarms": rates})
    assert again(made) == "dynreg drift friday --against monday"


@pytest.mark.parametrize(
    "verdict, says", [("still true", "Go on with monday"), ("too little data", "fewer --cells")]
)
def test_a_finished_drift_exits_0_whatever_its_verdict(verdict: str, says: str, dynreg, asked) -> None:
    asked.answers["drift"] = made_up_drift.drift(verdict)
    ended = dynreg("drift", "friday")
    assert ended.status == 0 and says in ended.out and "moved, the" not in ended.out


def test_without_an_earlier_recording_the_status_is_4(dynreg, asked) -> None:
    asked.answers["drift"] = NoMatchError("no earlier recording", expected="one", do="ingest it")
    ended = dynreg("drift", "friday")
    assert ended.status == 4 and "ingest it" in ended.err and ended.out == ""


@pytest.mark.parametrize(
    "line, says",
    [
        ("drift friday --cells 0", "--cells 0"),
        ("drift friday --splits -1", "--splits -1"),
        ("drift friday --cells 201", "--cells 201"),
        ("drift friday --sample 0", "--sample 0"),
        ("drift friday --sample nan", "--sample nan"),
        ("drift friday --level 1", "--level 1"),
        ("drift friday --level 0", "--level 0"),
        ("drift friday --seed -1", "--seed -1"),
        ("drift friday --out nowhere/table.parquet", "cannot write 'nowhere/table.parquet'"),
        ("drift friday --report nowhere/page.html", "cannot write 'nowhere/page.html'"),
        ("drift", "Missing argument 'RECORDING'"),
    ],
)
def test_misuse_is_refused_before_a_registry_is_opened(line: str, says: str, dynreg, asked) -> None:
    ended = dynreg(*line.split())
    assert ended.status == 2 and says in ended.err and asked.asked == []


def test_the_page_of_a_drift(dynreg, asked, tmp_path: Path) -> None:
    asked.answers["result"] = asked.answers["drift"]
    assert dynreg("report", "@last", "--out", tmp_path / "page.html").status == 0
    again = dynreg("drift", "friday", "--report", tmp_path / "again.html")
    assert again.status == 0 and "dynreg report" not in again.out
    assert (tmp_path / "again.html").read_bytes() == (tmp_path / "page.html").read_bytes()


def test_what_changed_on_a_robot_without_wheels_is_said_with_its_direction(dynreg, asked, tmp_path) -> None:
    import made_up_changes

    asked.answers["drift"] = made_up_changes.changes()
    ended = dynreg("drift", "friday", "--against", "monday", "--report", tmp_path / "page.html")
    text = " ".join(ended.out.split())
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100
    for words in (
        "From monday to friday, payload[elbow] (mass) rose by 0.31 [0.29, 0.33] kg.",
        "A change needs 8.1 nats",
        "what did not",
        "dynreg compare friday --with 121212121212,343434343434",
    ):
        assert words in text
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert html.count('class="pair ') == 2 and "path.s-extended" in html and "as monday was" in html
    asked.answers["drift"] = made_up_changes.changes(changed=False)
    assert "From monday to friday nothing changed that the recordings tell." in dynreg("drift", "friday").out

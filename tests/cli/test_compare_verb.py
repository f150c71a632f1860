"""`dynreg compare`: its options, what it refuses, its tables and its page."""

import json
from pathlib import Path

import made_up_comparison
import pytest

from dynreg.cli.schemas import model_of


def test_compare_passes_its_options_on(dynreg, session) -> None:
    line = "compare monday --models kinematic,dynamic --with nominal --with ab12 --starts 3 --generations 20"
    more = "--longest 0.5 --seed 4 --robot diffdrive --map m.toml --threads 2"
    assert dynreg(*line.split(), *more.split()).status == 0
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("compare", ("monday",))
    assert named == {
        "models": ("kinematic", "dynamic"),
        "simulators": ("nominal", "ab12"),
        "hold_out": None,
        "seed": 4,
        "starts": 3,
        "generations": 20,
        "longest": 0.5,
        "robot": "diffdrive",
        "log_map": Path("m.toml"),
        "threads": 2,
        "progress": named["progress"],
    }


def test_nothing_need_be_named(dynreg, session) -> None:
    from dynreg.compare.contenders import MODELS as KNOWN
    from dynreg.verbs.compare import MODELS

    assert dynreg("compare", "monday").status == 0
    named = session.asked[0][2]
    assert named["models"] is None and named["simulators"] is None and MODELS == tuple(KNOWN)


@pytest.mark.parametrize("line", ["--with nominal,ab12", "--with nominal --with ab12"])
def test_simulators_are_told_with_commas_or_one_by_one(line: str, dynreg, session) -> None:
    assert dynreg("compare", "monday", "--models", "", *line.split()).status == 0
    assert session.asked[0][2]["models"] == () and session.asked[0][2]["simulators"] == ("nominal", "ab12")


def test_an_arm_has_a_table_by_horizon_and_one_by_channel(dynreg, session) -> None:
    session.answers["compare"] = made_up_comparison.arm()
    ended = dynreg("compare", "tuesday")
    text = " ".join(ended.out.split())
    for words in (
        "tuesday: In rollouts of 2 s of held-out run_1 and run_3, extended ab12ab12 errs least: 50 [45, 55] %",
        "(50 % [45, 55])",
        "(tie)",
        "elbow/position rad",
        "80 of 0.1 s, 4 of 2 s, cut from run_1, run_3; left out, as a simulator was fitted to it: run_0, run_2[1]",
    ):
        assert words in text
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100 and "commands" not in text


def test_compare_answers_in_json_and_in_tables(dynreg, session) -> None:
    document = json.loads(dynreg("compare", "monday", "--json").out)
    assert model_of(document["schema"]).model_validate(document) == session.answers["compare"]
    ended = dynreg("compare", "monday")
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100
    text = " ".join(ended.out.split())
    for words in (
        "monday: On the last 40 commands, dynamic is off least",
        "nominal and synthesised ab12ab12 cannot be told from it",
        "kinematic - dynamic",
        "3 runs of 10 commands in a row",
        "models made from 174 commands and 40 to validate, judged on 40",
    ):
        assert words in text
    session.answers["compare"] = made_up_comparison.comparison(paths=False)
    assert "note: the test part has no ten commands" in " ".join(dynreg("compare", "monday").out.split())


@pytest.mark.parametrize(
    "line, says",
    [
        (
            "--models kinematic,magic",
            "--models 'magic'; expected one of kinematic, dynamic, table, network, mlp",
        ),
        ("--starts 0", "--starts 0"),
        ("--generations 0", "--generations 0"),
        ("--longest 0", "--longest 0"),
        ("--report nowhere/page.html", "cannot write 'nowhere/page.html'"),
    ],
)
def test_misuse_is_refused_before_a_registry_is_opened(line: str, says: str, dynreg, session) -> None:
    ended = dynreg("compare", "monday", *line.split())
    assert ended.status == 2 and says in ended.err and session.asked == []


def test_its_page_is_written(dynreg, session, tmp_path: Path) -> None:
    assert dynreg("compare", "monday", "--report", tmp_path / "page.html").status == 0
    assert "dynamic is off least" in (tmp_path / "page.html").read_text(encoding="utf-8")

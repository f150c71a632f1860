"""`dynreg drift`: what it passes on, what it prints, what it refuses, and its page."""

import json
from pathlib import Path

import made_up_drift
import pytest

from dynreg.cli.schemas import model_of
from dynreg.errors import NoMatchError


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
                "seed": 4,
                "out": Path("table.parquet"),
                "robot": "diffdrive",
                "log_map": Path("m.toml"),
                "progress": None,
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
    asked.answers["drift"] = made_up_drift.drift(rivals=("left wheel", "all speeds"))
    ended = dynreg("drift", "friday")
    assert "which these commands cannot tell apart" in " ".join(ended.out.split())
    assert "record left +0.19, right +0.19 m/s" in ended.out and "monday has none of these" in ended.out


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

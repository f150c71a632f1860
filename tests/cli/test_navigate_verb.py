"""`dynreg navigate`: what it passes on, what it refuses, its tables, its file and its page."""

import csv
import json
from pathlib import Path

import made_up_navigation
import pytest

from dynreg.cli.schemas import model_of
from dynreg.results import Interval


@pytest.fixture
def asked(session):
    session.answers |= {"navigate": made_up_navigation.navigation()}
    return session


def test_navigate_passes_its_options_on(dynreg, asked) -> None:
    line = "navigate monday --visit 0.5,0.2 --visit -0.5,-0.2 --size 0.2 --no-back --area -1,-2,3,4 --on kinematic"
    more = (
        "--commands 6 --seconds 0.2,1.5 --generations 7 --drives 50 --seed 4 --robot diffdrive --map m.toml"
    )
    assert dynreg(*line.split(), *more.split(), "--threads", "2").status == 0
    ((verb, given, named),) = asked.asked
    assert (verb, given) == ("navigate", ("monday",))
    assert named == {
        "visit": ((0.5, 0.2), (-0.5, -0.2)),
        "size": 0.2,
        "back": False,
        "area": (-1.0, -2.0, 3.0, 4.0),
        "on": "kinematic",
        "commands": 6,
        "seconds": (0.2, 1.5),
        "generations": 7,
        "drives": 50,
        "seed": 4,
        "robot": "diffdrive",
        "log_map": Path("m.toml"),
        "threads": 2,
        "progress": named["progress"],
    }
    assert dynreg("navigate", "monday", "--visit", "0.5,0.2").status == 0
    named = asked.asked[1][2]
    assert named["back"] and named["on"] == "dynamic" and named["area"] is named["seconds"] is None


def test_navigate_answers_in_json_and_in_tables(dynreg, asked) -> None:
    line = ("navigate", "monday", "--visit", "0.5,0.2")
    document = json.loads(dynreg(*line, "--json").out)
    assert model_of(document["schema"]).model_validate(document) == asked.answers["navigate"]
    ended = dynreg(*line)
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100
    text = " ".join(ended.out.split())
    for words in (
        "monday: 2 commands (2.22 s) visit 2 of 2 places and end 1.2 cm from the start, says dynamic.",
        "With its held-out errors, 430 of 500 drives visit all.",
        "1.5 0.72 -3 4",
        "0.5 -0.2 visited 90 %",
        "The middle 90 % of the drives end 0.4 to 6.1 cm from the start.",
        "is off by dx 0.13 cm, dy 0.15 cm, dtheta 0.7 deg on average, on 40 held-out commands.",
        "next: dynreg report @last",
    ):
        assert words in text
    asked.answers["navigate"] = made_up_navigation.navigation(missed=True)
    text = " ".join(dynreg(*line).out.split())
    assert (
        "visit 1 of 2 places" in text
        and "-0.2 missed" in text
        and "note: this is the best plan found" in text
    )


def test_its_file_holds_a_row_for_each_command_and_its_page_the_path(dynreg, asked, tmp_path: Path) -> None:
    asked.answers["navigate"] = made_up_navigation.navigation(missed=True)
    page = tmp_path / "page.html"
    ended = dynreg("navigate", "monday", "--visit", "0.5,0.2", "-o", "plan.csv", "--report", page)
    assert ended.status == 0 and "plan.csv: written" in ended.err and "next:" not in ended.out
    names, *rows = csv.reader(Path("plan.csv").read_text(encoding="utf-8").splitlines())
    assert names == ["time", "seconds", "left_wheel/velocity_command", "right_wheel/velocity_command"]
    assert [[*map(float, row)] for row in rows] == [[0, 1.5, 9.5, 7.25], [1.5, 0.72, -3, 4], [2.22, 0, 0, 0]]
    text = page.read_text(encoding="utf-8")
    drawn = {name: text.count(f'class="s-{name}"') for name in ("model", "drive", "visited", "missed")}
    assert drawn == {"model": 1, "drive": 1, "visited": 1, "missed": 1}
    for words in ("86 %</b>", "visit 1 of 2 places", "left_wheel/velocity_command [rad/s]", "480 of 500"):
        assert words in text


def test_words_fit_their_numbers(dynreg, asked) -> None:
    """One command, lengths of metres and of nearly nothing, and what such long commands leave open."""
    whole = made_up_navigation.navigation()
    far = Interval(value=1.0, low=0.004, high=2.25, unit="m")
    limits = whole.limits.model_copy(update={"beyond": True})
    asked.answers["navigate"] = whole.model_copy(
        update={"commands": whole.commands[:1], "end": 2.2, "drive_ends": far, "limits": limits}
    )
    line = ("navigate", "monday", "--visit", "0.5,0.2")
    text = " ".join(dynreg(*line).out.split())
    for words in (
        "monday: 1 command (2.22 s) visits 2 of 2 places and ends 2.2 m from the start",
        "With its held-out errors, which hardly tell of such long commands, 430 of 500 drives visit all.",
        "The middle 90 % of the drives end 0.4 cm to 2.2 m from the start.",
    ):
        assert words in text
    asked.answers["navigate"] = whole.model_copy(update={"end": 8.3e-7})
    assert "end under 0.01 cm from the start" in " ".join(dynreg(*line).out.split())
    asked.answers["navigate"] = whole.model_copy(update={"end": 0.996})
    assert "end 1 m from the start" in " ".join(dynreg(*line).out.split())


MISUSE = (
    ("", "Missing option '--visit'"),
    ("--visit 0.5", "--visit '0.5'; expected metres ahead and metres to the left"),
    ("--visit a,b", "--visit 'a,b'"),
    ("--visit nan,1", "--visit 'nan,1'"),
    ("--visit 1,2,3 --visit 4", "--visit '1,2,3'; expected metres ahead and metres to the left"),
    ("--visit 0.5 --visit 0.2", "--visit '0.5'; expected metres ahead and metres to the left"),
    ("--visit 1,,2", "--visit '1,,2'"),
    ("--visit 1.5,1.5 --area 1,1,2,2", "--area '1,1,2,2' leaves out the start"),
    ("--visit 0.5,0 --visit 1,0 --area -1,-1,0.7,1", "--area '-1,-1,0.7,1' leaves out the place 1,0"),
    ("--visit 1,0 --area 0,0,1", "--area '0,0,1'; expected lowest x and y"),
    ("--visit 1,0 --area 0,1,1,0", "lowest below highest, such as -1,-1,1,1; give area so"),
    ("--visit 1,0 --area 1,0,0,1", "--area '1,0,0,1'"),
    ("--visit 1,0 --seconds 2,1", "--seconds '2,1'; expected the shortest"),
    ("--visit 1,0 --seconds 0,1", "above 0, shortest first, such as 0.2,2; give seconds so"),
    ("--visit 1,0 --on magic", "--on 'magic'; expected one of kinematic, dynamic"),
    ("--visit 1,0 --size 0", "--size 0"),
    ("--visit 1,0 --commands 0", "--commands 0"),
    ("--visit 1,0 -o nowhere/plan.csv", "cannot write 'nowhere/plan.csv'"),
    ("--visit 1,0 --report nowhere/page.html", "cannot write 'nowhere/page.html'"),
)


def test_misuse_is_refused_before_a_registry_is_opened(dynreg, asked) -> None:
    for line, says in MISUSE:
        ended = dynreg("navigate", "monday", *line.split())
        assert ended.status == 2 and says in ended.err and asked.asked == [], line

"""The page: whole, self-contained, safe, always the same bytes, and true to the result."""

import re
import sys
from html.parser import HTMLParser
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import made_up_comparison
import made_up_diagnosis
import made_up_gait
import made_up_results
import pytest
from pydantic import Field

from dynreg.errors import UsageError
from dynreg.report.drawing import HEIGHT, WIDTH, chart, ticks, track
from dynreg.report.html import page, write_report
from dynreg.results import Neighbours, Result, TrialTable

RESULTS = {
    "synthesised": made_up_results.neighbours(),
    "neighbour": made_up_results.neighbours(kind="neighbour"),
    "nominal": made_up_results.neighbours(kind="nominal"),
    "alarm": made_up_results.neighbours(fits=False),
    "nothing held out": made_up_results.neighbours(held_out=False),
    "one neighbour": made_up_results.neighbours(k=1),
    "bare": made_up_results.neighbours().model_copy(
        update={"synthesised": None, "gain": None, "traces": (), "channels": (), "stages": (), "notes": ()}
    ),
    "calibration": made_up_results.calibration(),
    "calibration without test": made_up_results.calibration().model_copy(
        update={"test_error": None, "nominal_test_error": None, "history": ()}
    ),
    "diagnosis": made_up_diagnosis.diagnosis(),
    "ambiguous": made_up_diagnosis.diagnosis("ambiguous"),
    "partly explained": made_up_diagnosis.diagnosis("partly_explained"),
    "unknown cause": made_up_diagnosis.diagnosis("unknown", held_out=False),
    "nothing missing": made_up_diagnosis.diagnosis("none", traced=False),
    "bare diagnosis": made_up_diagnosis.diagnosis("none", traced=False).model_copy(
        update={"ranking": (), "parameters": {}, "where": (), "finding": "", "noise": None, "errors": ()}
    ),
    "trials": made_up_diagnosis.trials(),
    "gait": made_up_gait.gait(),
    "gait that falls": made_up_gait.gait(fell=True),
    "trials of gaits": made_up_gait.rounds(),
    "comparison": made_up_comparison.comparison(),
    "comparison without paths": made_up_comparison.comparison(paths=False),
    "no trials": TrialTable.of("leg", []),
}
VOID = {"meta", "br", "link", "img", "hr"}


class Balance(HTMLParser):
    """Open elements, and a complaint where one is closed that is not open."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag) -> None:
        assert self.open and self.open[-1] == tag, (tag, self.open)
        self.open.pop()

    def handle_data(self, data) -> None:
        self.text += data


def words(html: str) -> str:
    reader = Balance()
    reader.feed(re.sub(r"<style>.*</style>", "", html, flags=re.DOTALL))
    assert reader.open == []
    return " ".join(reader.text.split())


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_a_page_is_well_formed_and_needs_nothing_else(result) -> None:
    html = page(result)
    assert words(html)
    assert not re.search(r"<script|<link|<img|@import|url\(|https?://", html)
    assert "None" not in words(html) and "nan" not in words(html)


def test_the_same_result_gives_the_same_bytes(tmp_path: Path) -> None:
    first = write_report(RESULTS["synthesised"], tmp_path / "a.html")
    second = write_report(made_up_results.neighbours(), tmp_path / "b.html")
    assert first.read_bytes() == second.read_bytes()


def test_the_page_says_what_the_result_says() -> None:
    result = RESULTS["synthesised"]
    text = words(page(result))
    assert "use the synthesised simulator c0ffee" in text
    assert result.population in text and result.answer in text and result.recording in text
    for neighbour in result.neighbours:
        assert neighbour.name in text
    for name in result.nominal.parameters:
        assert name in text
    for note in result.notes:
        assert note in text
    assert "31 %" in text and "22 to 37 %" in text


def test_an_alarm_stands_on_the_page_and_only_then() -> None:
    assert RESULTS["alarm"].alarm in words(page(RESULTS["alarm"]))
    assert 'role="alert"' in page(RESULTS["alarm"])
    assert 'role="alert"' not in page(RESULTS["synthesised"])


def test_there_is_a_drawing_for_each_trace() -> None:
    result: Neighbours = RESULTS["synthesised"]
    assert page(result).count("<svg") == len(result.traces)
    assert page(RESULTS["bare"]).count("<svg") == 0


def test_lines_that_run_together_can_be_told_apart() -> None:
    html = page(RESULTS["nominal"])
    for drawing in re.findall(r"<svg.*?</svg>", html, flags=re.DOTALL):
        assert re.findall(r"s-(\w+)", drawing) == ["measured", "answer", "nominal"], "the dashed one on top"
    (dashed,) = re.findall(r"path\.s-nominal {[^}]*stroke-dasharray: (\d+) (\d+)", html)
    assert int(dashed[1]) >= 4, "gaps that the answer shows through"
    assert '<i class="nominal dashed">' in html
    assert "the two lines coincide" in words(html)
    assert "its line runs under" not in words(page(RESULTS["synthesised"]))


def test_names_from_a_log_cannot_become_markup() -> None:
    hostile = made_up_results.neighbours(fits=False).model_copy(
        update={"recording_name": "<script>alert(1)</script>", "alarm": "<b>x</b>", "notes": ("<i>y</i>",)}
    )
    html = page(hostile)
    assert "<script" not in html and "<b>x" not in html and "<i>y" not in html


def test_what_has_no_page_is_an_error_that_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no report.*query or calibration"):
        write_report(made_up_results.recording(), tmp_path / "page.html")
    with pytest.raises(UsageError, match="cannot write"):
        write_report(made_up_results.neighbours(), tmp_path / "missing" / "page.html")


class Counted(Result):
    """The answer of a verb that came later."""

    schema_: Literal["dynreg/counted/1"] = Field(default="dynreg/counted/1", alias="schema")
    robot: str
    counts: dict[str, float | None]

    def rows(self) -> list[dict[str, Any]]:
        return [{"what": what, "count": count} for what, count in self.counts.items()]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        return {"What there is": self.rows(), "What there is not": []}


def test_a_verb_that_came_later_needs_no_template_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    room = ModuleType("dynreg.report.counted")
    room.__spec__ = ModuleSpec(room.__name__, None)
    room.page = lambda result: {
        "result": result,
        "title": f"Counts · {result.robot}",
        "verdict": "Two <b>rows</b>.",
        "tiles": [("2", "rows")],
        "steps": ("Count again.",),
        "charts": [chart("rise", "time [s]", [0.0, 1.0], {"answer": [0.0, 2.0]})],
    }
    monkeypatch.setitem(sys.modules, room.__name__, room)
    html = page(Counted(robot="leg", counts={"[rows]": 2.25, "gaps": None}))
    text = words(html)
    for said in (
        "Counts · leg",
        "Two <b>rows</b>.",
        "2rows",
        "Count again.",
        "What there is",
        "[rows]2.25",
        "gaps-",
    ):
        assert said in text, said
    assert "What there is not" not in text and "None" not in text and "<svg" in html
    room.page = lambda result: {"result": result, "title": "Counts"}
    html = page(Counted(robot="leg", counts={"rows": 2.0}))
    assert "<h1>Counts</h1>" in html and "What there is" in words(html) and "schema_" not in words(html)


def test_curves_stay_in_their_box_and_break_at_missing_values() -> None:
    drawn = chart("x", "t", [0.0, 1.0, 2.0, 3.0, 4.0], {"measured": [0.0, 5.0, None, -5.0, 1.0]})
    (line,) = drawn.lines
    points = [tuple(map(float, p.split())) for p in re.findall(r"[ML]([^ML]+)", line.path)]
    assert len(points) == 4 and line.path.count("M") == 2
    assert all(0 <= x <= WIDTH and 0 <= y <= HEIGHT for x, y in points)
    assert points[1][1] < points[0][1] < points[2][1]  # up is up


def test_nothing_to_draw_gives_no_chart() -> None:
    assert chart("x", "t", [0.0, 1.0], {"measured": [None, None]}) is None
    assert chart("x", "t", [0.0], {"measured": [1.0]}) is None


@pytest.mark.parametrize("low, high", [(0.0, 1.0), (-3.7, 12.2), (1e-6, 3e-6), (99.0, 100.0), (-1e5, 1e5)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 2 <= len(found) <= 11
    assert all(low - 1e-9 * abs(low) <= t <= high + 1e-9 * abs(high) for t in found)
    assert found == sorted(found)


def test_a_constant_still_has_a_tick_and_a_chart() -> None:
    assert ticks(2.0, 2.0) == [2.0]
    assert chart("x", "t", [0.0, 1.0], {"answer": [2.0, 2.0]}) is not None


def test_a_track_spans_its_limits_and_holds_everything() -> None:
    drawn = track(0.5, 0.45, 0.55, 0.49, [0.42, 0.58], (0.4, 0.6))
    assert drawn.left == pytest.approx(25) and drawn.width == pytest.approx(50)
    assert drawn.value == pytest.approx(50) and drawn.nominal == pytest.approx(45)
    beyond = track(0.7, 0.6, 0.8, 0.3, [], (0.4, 0.6))
    assert beyond.nominal == 0 and beyond.left + beyond.width == pytest.approx(100)
    exact = track(1.0, 1.0, 1.0, 1.0, [])
    assert 0 < exact.value < 100 and exact.width > 0


def test_an_interval_is_drawn_only_where_there_is_one():
    """A search by calibration gives none: neither a bar at its values, nor a word of it in the legend."""
    without, given = page(RESULTS["calibration"]), page(RESULTS["one neighbour"])
    assert 'class="span"' not in without and "90 % interval" not in without
    assert 'class="span"' in given and "90 % interval</span>" in given

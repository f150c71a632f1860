"""The page of a diagnosis, and of trials: what a reader must find, and that the drawings say what the numbers say."""

import re

import made_up_diagnosis
import pytest
from test_html import words

from dynreg.report.diagnosis.drawn import REGIMES
from dynreg.report.diagnosis.drawn import page as diagnosis_page
from dynreg.report.drawing import ROOM, ruler
from dynreg.report.html import page
from dynreg.results import Where

VERDICTS = ("named", "ambiguous", "partly_explained", "unknown", "none")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_says_what_the_diagnosis_says(verdict: str) -> None:
    result = made_up_diagnosis.diagnosis(verdict)
    text = words(page(result))
    assert result.sentence in text and result.finding in text
    for cause in result.causes:
        assert cause.key in text and cause.title in text
        assert all(name in text for name in cause.parameters)
    for ranked in (r for r in result.ranking if r.score_nats >= 0):
        assert f"{ranked.key} " in text and f"{ranked.score_nats:.1f}" in text
    for name in (*result.parameters, *(m.name for m in result.moved)):
        assert name in text
    for line in (*result.experiments, *result.inputs, *result.notes):
        assert line in text
    assert "18.4 nats" in text and "20 simulations" in text and result.recording in text


def test_traces_are_told_apart_by_dash_and_by_colour() -> None:
    html = page(made_up_diagnosis.diagnosis())
    for drawing in re.findall(r"<svg.*?</svg>", html, flags=re.DOTALL):
        assert re.findall(r"s-(\w+)", drawing) == ["measured", "extended", "calibrated", "nominal"]
    style = re.search(r"<style>(.*)</style>", html, flags=re.DOTALL)[1]
    dashes = {
        n: re.findall(rf"path\.s-{n} {{[^}}]*dasharray: ([\d. ]+)", style) for n in ("nominal", "calibrated")
    }
    assert dashes["nominal"] != dashes["calibrated"] and all(dashes.values())
    assert not re.search(r"path\.s-(extended|measured) {[^}]*dasharray", style)
    colours = {
        re.search(rf"path\.s-{n} {{[^}}]*stroke: ([^;]+)", style)[1] for n in ("nominal", "calibrated")
    }
    assert len(colours) == 2
    shown = words(html)
    assert "extended: with the cause" in shown and "dotted" in html


def test_a_simulator_that_was_not_made_is_not_in_the_legend() -> None:
    html = page(made_up_diagnosis.diagnosis("none"))
    assert "s-extended" not in re.sub(r"<style>.*</style>", "", html, flags=re.DOTALL)
    assert "extended: with the cause" not in words(html)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_bars_pass_the_threshold_when_their_score_does(verdict: str) -> None:
    result = made_up_diagnosis.diagnosis(verdict)
    for ranking in diagnosis_page(result)["rankings"]:
        assert 0 < ranking["threshold"] < 100
        for bar in ranking["bars"]:
            assert 0 <= bar["width"] <= 100
            assert (bar["width"] > ranking["threshold"]) == (float(bar["nats"]) > result.threshold_nats)


def test_rounds_stand_apart_and_causes_are_marked() -> None:
    first, second = diagnosis_page(made_up_diagnosis.diagnosis("partly_explained"))["rankings"]
    assert first["title"] == "" and second["title"] == "After load_friction[arm]"
    kinds = {bar["key"]: bar["kind"] for bar in second["bars"]}
    assert kinds == {"command_delay": "chosen", "sensor_delay": "tied"}
    assert [b["key"] for b in first["bars"] if b["kind"]] == ["load_friction[arm]"]


def test_many_channels_are_rows_and_few_are_columns() -> None:
    few = diagnosis_page(made_up_diagnosis.diagnosis())["maps"][0]
    assert few["columns"] == ["arm/position", "arm/velocity"] and few["rows"][1][0] == "reversals"
    where = [
        Where(channel=f"c{i}", regime=regime, share=0.01 * (i + 1))
        for i in range(14)
        for regime in ("overall", "low_speed")
    ]
    many = made_up_diagnosis.diagnosis().model_copy(update={"where": tuple(where)})
    (shown,) = diagnosis_page(many)["maps"]
    assert shown["columns"] == ["overall", "low speed"]
    assert shown["rows"][0][0] == "c13", "the largest share first"
    assert len(shown["rows"]) + shown["more"] == 14
    assert "more channels" in words(page(many))


def test_shares_of_the_table_are_those_of_the_result() -> None:
    result = made_up_diagnosis.diagnosis()
    (calibrated, _) = diagnosis_page(result)["maps"]
    told = {
        (channel, regime): cell["percent"]
        for regime, cells in calibrated["rows"]
        for channel, cell in zip(calibrated["columns"], cells, strict=True)
    }
    given = {
        (w.channel, REGIMES.get(w.regime, w.regime.replace("_", " "))): 100 * w.share
        for w in result.where
        if w.simulator == "calibrated"
    }
    assert told == pytest.approx(given)


@pytest.mark.parametrize("verdict", ["unknown", "partly_explained"])
def test_the_residual_is_shown_by_the_signals_that_predict_it(verdict: str) -> None:
    result = made_up_diagnosis.diagnosis(verdict)
    (left,) = diagnosis_page(result)["rests"]
    assert left["bars"] == [("position", pytest.approx(14)), ("sign of velocity", pytest.approx(5))]
    said = (
        "The unexplained acceleration of arm is 3.1 rad/s^2 (1 sigma)."
        " Its signals predict 19 % of it on unseen data"
    )
    assert f"{said}: position 14 %, sign of velocity 5 %." in words(page(result))
    untold = made_up_diagnosis.diagnosis(verdict).model_copy(update={"residual": ()})
    assert "Its signals predict none of it." in words(page(untold))
    assert not diagnosis_page(made_up_diagnosis.diagnosis("named"))["rests"]


def test_a_channel_without_a_share_is_no_column() -> None:
    result = made_up_diagnosis.diagnosis()
    silent = tuple(
        w.model_copy(update={"share": 0.0}) if w.channel == "arm/velocity" else w for w in result.where
    )
    shown = diagnosis_page(result.model_copy(update={"where": silent}))["maps"]
    assert [m["columns"] for m in shown] == [["arm/position"]] * 2


def test_errors_share_an_axis_with_their_repeatability() -> None:
    first, second = diagnosis_page(made_up_diagnosis.diagnosis())["errors"]
    assert [round(percent) for _, _, percent in first["bars"]] == [100, 94, 65]
    assert first["floor"] == pytest.approx(100 * 0.0041 / 0.0652)
    assert second["floor"] is None


def test_a_pull_is_told_where_there_is_one() -> None:
    text = words(page(made_up_diagnosis.diagnosis()))
    assert "pulled by +2.6 sigma" in text and text.count("pulled by") == 4


def test_a_ruler_holds_everything_on_the_side_of_the_value() -> None:
    for sign in (1.0, -1.0):
        drawn = ruler(sign * 0.21, *sorted((sign * 0.18, sign * 0.24)), {"weak": 0.03, "strong": 0.2})
        places = [m.place for m in drawn.marks]
        assert all(0 <= p <= 100 for p in (*places, drawn.left, drawn.value, drawn.left + drawn.width))
        assert (places[0] < places[1] < drawn.value) == (sign > 0)
        assert drawn.left < drawn.value < drawn.left + drawn.width


def test_marks_too_near_to_each_other_share_one_label() -> None:
    near = ruler(4.0, 3.5, 4.0, {"weak": 0.05, "medium": 0.1, "strong": 0.2}).marks
    assert [m.label for m in near] == ["", "", "strong"]
    apart = ruler(0.2, 0.15, 0.25, {"weak": 0.03, "medium": 0.12, "strong": 0.21}).marks
    labelled = [m.place for m in apart if m.label]
    assert len(labelled) == 3 and all(b - a >= ROOM for a, b in zip(labelled, labelled[1:], strict=False))


def test_names_from_a_log_cannot_become_markup() -> None:
    hostile = made_up_diagnosis.diagnosis().model_copy(
        update={"recording_name": "<script>x</script>", "sentence": "<b>x</b>", "notes": ("<i>y</i>",)}
    )
    html = page(hostile)
    assert "<script" not in html and "<b>x" not in html and "<i>y" not in html


def test_the_page_of_trials_shows_every_rate_with_its_interval() -> None:
    result = made_up_diagnosis.trials()
    text = words(page(result))
    assert "8 of 10 hidden effects named right" in text and "1 false alarm in 4 robots" in text
    assert "49 to 96 %" in text and "stribeck_friction" in text and "Clopper-Pearson" in text
    for group in result.by_effect:
        assert f"{group.hidden or 'nothing'} 0100 % {group.right.hits} of {group.right.of}" in text

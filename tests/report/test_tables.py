"""Tables and sentences: narrow, complete, and honest about what is not known."""

import io
import re

import made_up_comparison
import made_up_results
import pytest
from rich.console import Console

from dynreg.cli.output import console
from dynreg.report import doctor
from dynreg.report.grid import table
from dynreg.report.html import page
from dynreg.report.neighbours import comparison, next_steps, refusal, verdict
from dynreg.report.tables import render
from dynreg.results import Gain, Result
from dynreg.results.doctor import LogFinding, LogFindings


def text_of(result: Result) -> str:
    stream = io.StringIO()
    console(stream).print(render(result))
    return stream.getvalue()


@pytest.mark.parametrize("result", made_up_results.every_kind(), ids=lambda r: type(r).__name__)
def test_every_result_prints_within_100_columns(result: Result) -> None:
    text = text_of(result)
    assert text.strip() and max(map(len, text.splitlines())) <= 100
    assert "\x1b" not in text and "None" not in text


def test_many_neighbours_and_long_names_stay_within_the_width() -> None:
    result = made_up_results.neighbours(k=40)
    long = {f"{name}_of_the_upper_left_leg": value for name, value in result.nominal.parameters.items()}
    wide = result.model_copy(update={"nominal": result.nominal.model_copy(update={"parameters": long})})
    text = text_of(wide)
    assert max(map(len, text.splitlines())) <= 100
    told = " ".join(text.split())
    assert "best 40 by replay error, of the nearest by the distance" in told and "the first 5 shown" in told
    unreplayed = tuple(s for s in wide.stages if s.stage != "replayed")
    told = " ".join(text_of(wide.model_copy(update={"stages": unreplayed})).split())
    assert "40 nearest neighbours by the distance" in told and "best 40" not in told


def test_a_population_that_has_as_many_says_that_none_were_added() -> None:
    grown = made_up_results.population()
    assert "1000 of 1000 simulators, 1000 added in 74.2 s" in text_of(grown) and "simulate" in text_of(grown)
    none = {"added": 0, "simulate_seconds": 0.0, "train_seconds": 0.0, "link_seconds": 0.0}
    text = text_of(grown.model_copy(update=none))
    assert "1000 of 1000 simulators, none added" in text and "simulate" not in text
    assert "simulate" in text_of(grown.model_copy(update=none | {"link_seconds": 3.0})), "it was linked anew"


def test_one_rollout_is_to_be_cut_before_any_of_it_can_be_held_out() -> None:
    none = {"test_error": None, "nominal_test_error": None}
    for fit, told in ((("run",), "a horizon of at most a quarter"), (("a", "b", "c"), "or use --hold-out.")):
        parts = {"fit": fit, "select": (), "test": ()}
        found = made_up_results.calibration().model_copy(update=none | {"parts": parts})
        assert "Nothing was held out" in text_of(found) and told in " ".join(text_of(found).split())


def test_brackets_in_names_are_printed_as_they_are() -> None:
    text = text_of(made_up_results.recording().model_copy(update={"name": "[bold]run[/bold] :smile:"}))
    assert "[bold]run[/bold] :smile:" in text


def test_numbers_stand_right_and_words_left() -> None:
    stream = io.StringIO()
    console(stream).print(table(("a", "b"), [("x", 1.0), ("yy", 123.0)]))
    lines = [line.rstrip() for line in stream.getvalue().splitlines()]
    assert lines[-1].startswith("yy") and lines[-2].endswith("  1") and lines[-1].endswith("123")


def test_the_verdict_follows_the_answer() -> None:
    assert "synthesised simulator c0ffee" in verdict(made_up_results.neighbours())
    assert "servo_pendulum-417" in verdict(made_up_results.neighbours(kind="neighbour"))
    assert "use the nominal model" in verdict(made_up_results.neighbours(kind="nominal"))
    assert "No simulator" in verdict(made_up_results.neighbours(fits=False))


def test_an_answer_that_held_out_data_do_not_show_to_be_better_is_not_recommended() -> None:
    found = made_up_results.neighbours()
    for low, high in ((-0.06, 0.06), (-0.3, -0.1), (0.0, 0.2)):
        unclear = found.model_copy(update={"gain": Gain(value=(low + high) / 2, low=low, high=high)})
        assert verdict(unclear) == "For bench_monday, no simulator here is clearly better than nominal."
        assert comparison(unclear).startswith("The best is the synthesised simulator c0ffee")
        assert "no simulator here is clearly better than nominal" in str(unclear)
        steps = next_steps(unclear)
        assert "Ask what all of them lack: dynreg diagnose bench_monday" in steps
        assert not any("export" in step for step in steps)
        assert refusal(unclear) is None, "the family fits"
        lost = made_up_results.neighbours(fits=False).model_copy(update={"gain": unclear.gain})
        assert sum("dynreg diagnose" in step for step in next_steps(lost)) == 1


def test_without_an_interval_no_answer_is_recommended() -> None:
    """Too few windows, or none, held out: a loss is told as one, a gain as not known to be one."""
    found = made_up_results.neighbours()
    worse = found.model_copy(update={"gain": Gain(value=-0.64, low=None, high=None)})
    assert verdict(worse) == "For bench_monday, no simulator here is clearly better than nominal."
    assert "64 % higher" in comparison(worse) and not any("export" in step for step in next_steps(worse))
    few = found.model_copy(update={"gain": Gain(value=0.3, low=None, high=None)})
    none = made_up_results.neighbours(held_out=False).model_copy(update={"gain": None})
    for one, why in ((few, "too few windows were held out"), (none, "nothing was held out")):
        assert "not known whether it is better than nominal" in verdict(one) and why in verdict(one)
        for said in (verdict(one), str(one)):
            assert why in said and "use" not in said
    assert any("Nothing was held out" in step and "--hold-out" in step for step in next_steps(none))
    single = none.model_copy(update={"parts": {"fit": ("run",), "select": (), "test": ()}})
    assert any("[replay] of robot.toml a horizon" in step for step in next_steps(single))
    known = made_up_results.neighbours(kind="nominal", held_out=False)
    assert known.unknown == "", "the nominal simulator is no better than itself"


def test_an_answer_whose_search_had_not_ended_is_not_to_be_relied_on() -> None:
    """Whether it fits is not known: the alarm is silent, and no more than that."""
    changes = {"fits": None, "misfit": 34.0, "misfit_limit": 1.5, "sharpened": True}
    found = made_up_results.neighbours().model_copy(update=changes)
    for said in (verdict(found), str(found)):
        assert "the search had not ended" in said and "use" not in said
    assert refusal(found) is None and "not known whether it fits" in found.brief()
    assert not found.reliable and "the search had not ended" in found.reliance
    assert any("ask again with twice the --budget" in step for step in next_steps(found))
    assert not any("export" in step for step in next_steps(found))
    assert "unreliable interval" in text_of(found)


def test_a_loss_is_not_called_a_gain() -> None:
    worse = made_up_results.neighbours().model_copy(update={"gain": Gain(value=-0.2, low=None, high=None)})
    assert "20 % higher than nominal" in comparison(worse) and "too few windows" in comparison(worse)
    clearly = worse.model_copy(update={"gain": Gain(value=-0.2, low=-0.3, high=-0.1)})
    assert "20 % higher than nominal (90 % interval: 10 to 30 % higher)." in comparison(clearly)
    unclear = worse.model_copy(update={"gain": Gain(value=0.03, low=-0.08, high=0.1)})
    assert comparison(unclear).endswith("8 % higher to 10 % lower): no clear difference.")


def test_where_nothing_fits_no_number_recommends_the_best() -> None:
    result = made_up_results.neighbours(fits=False)
    assert verdict(result).endswith("do not rely on the best one.")
    assert "31 % lower than nominal" in comparison(result) and comparison(result).endswith(
        "too large for a fit."
    )
    assert "no simulator of this population fits" in str(result)
    assert "value [unreliable interval]" in text_of(result) and result.reliance in text_of(result)
    assert "value [90 % interval]" in text_of(made_up_results.neighbours())


def test_channels_that_are_not_scored_are_marked() -> None:
    result = made_up_results.neighbours()
    assert "not scored" not in text_of(result) + page(result)
    position, velocity = result.channels
    derived = velocity.model_copy(update={"scored": False})
    half = result.model_copy(update={"channels": (position, derived)})
    for text in (text_of(half), page(half)):
        assert "arm/velocity (not scored)" in text and "arm/position (not scored)" not in text
        assert "have weight 0 in robot.toml" in text
    compared = made_up_comparison.arm()
    some = compared.rollouts.model_copy(update={"unscored": ("shoulder/position",)})
    assert some.channels == ("elbow/position", "shoulder/position")
    other = compared.model_copy(update={"rollouts": some})
    for text in (text_of(other), page(other)):
        assert "shoulder/position (not scored)" in text and "have weight 0 in robot.toml" in text


def test_next_steps_follow_the_result() -> None:
    assert any("--as robot --to FOLDER" in step for step in next_steps(made_up_results.neighbours()))
    alarmed = next_steps(made_up_results.neighbours(fits=False))
    assert any("dynreg doctor" in step for step in alarmed) and not any("export" in s for s in alarmed)
    assert any("--hold-out" in step for step in next_steps(made_up_results.neighbours(held_out=False)))


def test_the_cost_counts_evaluations_not_simulators() -> None:
    found = made_up_results.neighbours()
    two_stages = found.model_copy(
        update={"simulators": 8, "cost": found.cost.model_copy(update={"evaluations": 16})}
    )
    assert "cost: 16 distance evaluations among 8 simulators, " in text_of(two_stages)


@pytest.mark.parametrize("width", [64, 80, 100])
def test_no_number_is_broken_where_names_can_be(width: int) -> None:
    """In two lines, 4.32e-05 reads as 4.32e-0."""
    names = (
        "channel",
        "nominal simulator",
        "calibrated",
        "no prior",
        "extended",
        "repeatability of it",
        "unit",
    )
    row = ("shoulder_lift_joint/position", 0.000734, 4.32e-05, 0.00123, 12.3, None, "rad")
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(table(names, [row, ("elbow/position", 1.0, 2.0, 3.0, 4.0, 5.0, "m")], "errors"))
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= width
    (line,) = (line for line in lines if "4.32e-05" in line)
    assert {"0.000734", "4.32e-05", "0.00123", "12.3", "rad"} <= {*line.split()}


@pytest.mark.parametrize(
    ("message", "do", "said"),
    [
        (
            "1 samples; at least 2 are needed",
            "",
            "a.csv: 1 samples; at least 2 are needed; expected a log that passes the checks; mend the log or its map",
        ),
        (
            "reaches 90 rad; degrees?",
            "set `unit`",
            "a.csv: reaches 90 rad; degrees?; expected a log that passes the checks; set `unit`",
        ),
        (
            "there is no log 'a.csv'; expected an existing file",
            "check the path",
            "there is no log 'a.csv'; expected an existing file; check the path",
        ),
    ],
)
def test_the_error_of_a_log_says_what_its_finding_says(message: str, do: str, said: str):
    found = LogFinding(severity="error", check="short", where="a.csv", message=message, do=do)
    error = doctor.refusal(LogFindings(logs=("a.csv",), robot=None, usable=False, findings=(found,)))
    assert str(error) == said


def test_what_the_error_of_a_log_says_is_in_no_table():
    """Alike findings are one, with the first place and how many more."""
    alike = [LogFinding(severity="error", check="nan", where=f"{n}.csv", message="no number") for n in "abc"]
    far = dict(severity="error", check="units", message="too far", do="set `unit`")
    others = [LogFinding(where=where, **far) for where in ("b.csv", "c.csv")]
    told = LogFindings(logs=("a.csv",), robot=None, usable=False, findings=(*alike, *others))
    assert str(doctor.refusal(told)).startswith("a.csv and 2 places more: no number (and 1 more); expected")
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(doctor.tables(told))
    text = console.export_text()
    assert "no number" not in text
    assert re.search(r"error +units +b\.csv and 1 place more +too far; set `unit`", text)

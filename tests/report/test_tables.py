"""Tables and sentences: narrow, complete, and honest about what is not known."""

import io

import made_up_results
import pytest

from dynreg.cli.output import console
from dynreg.report.grid import table
from dynreg.report.neighbours import next_steps, verdict
from dynreg.report.tables import render
from dynreg.results import Gain, Result


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
    assert "40 neighbours" in text and "the first 5" in text


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
    assert "nominal model stands" in verdict(made_up_results.neighbours(kind="nominal"))
    assert "No simulator" in verdict(made_up_results.neighbours(fits=False))


def test_a_loss_is_not_called_a_gain() -> None:
    worse = made_up_results.neighbours().model_copy(update={"gain": Gain(value=-0.2, low=None, high=None)})
    assert "20 % above the nominal" in verdict(worse) and "too few episodes" in verdict(worse)
    clearly = worse.model_copy(update={"gain": Gain(value=-0.2, low=-0.3, high=-0.1)})
    assert "20 % above the nominal" in verdict(clearly)
    unclear = worse.model_copy(update={"gain": Gain(value=0.03, low=-0.08, high=0.1)})
    assert "does not clearly differ" in verdict(unclear) and "below" not in verdict(unclear)


def test_next_steps_follow_the_result() -> None:
    assert any("dynreg export" in step for step in next_steps(made_up_results.neighbours()))
    alarmed = next_steps(made_up_results.neighbours(fits=False))
    assert any("dynreg doctor" in step for step in alarmed) and not any("export" in s for s in alarmed)
    assert any("--hold-out" in step for step in next_steps(made_up_results.neighbours(held_out=False)))

"""Progress where stderr is no terminal: plain lines, few of them, none of short commands."""

import time

import pytest

from dynreg.cli import output
from dynreg.cli.output import PlainProgress, progress_bars


def test_a_line_at_the_start_of_a_stage_and_then_every_ten_seconds(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    told = PlainProgress(clock=lambda: now[0])
    for second in range(41):
        now[0] = float(second)
        told("simulators", 5 * second, 400)
    told("link", 0, 1)
    told("link", 1, 1)
    assert capsys.readouterr().err.splitlines() == [
        "simulators: 2 %, about 78 s left",
        "simulators: 15 %, about 68 s left",
        "simulators: 27 %, about 58 s left",
        "simulators: 40 %, about 48 s left",
        "link ...",
    ]


def test_short_commands_and_quiet_ones_say_nothing(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    told = PlainProgress(clock=lambda: now[0])
    for tenth in range(15):
        now[0] = tenth / 10
        told("simulators", tenth, 15)
    with progress_bars(False) as nothing:
        assert nothing is None
    with progress_bars(True) as lines:
        lines("simulators", 0, 10)
    assert capsys.readouterr().err == ""


def test_a_step_that_takes_long_is_told_while_it_takes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """Nothing is reported while a big log is read."""
    for name, seconds in (("PATIENCE", 0.05), ("TICK", 0.01), ("EVERY", 0.2)):
        monkeypatch.setattr(output, name, seconds)
    with progress_bars(True) as told:
        told("read big.mcap", 0, 1)
        time.sleep(0.35)
        told("read big.mcap", 1, 1)
        time.sleep(0.1)
    assert capsys.readouterr().err.splitlines() == ["read big.mcap ...", "read big.mcap: 0 s so far"]


def test_what_makes_it_faster_is_told_once_and_of_long_commands_alone(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    for total, lines in ((20000, 1), (200, 0)):
        now[0] = 0.0
        told = PlainProgress(clock=lambda: now[0], faster="--joints A,B is faster")
        for second in range(60):
            now[0] = float(second)
            told("simulations", second * 2, total)
        said = [line for line in capsys.readouterr().err.splitlines() if "faster" in line]
        assert said == ["simulations: this takes about 2.8 h; --joints A,B is faster"] * lines


def test_tenths_of_a_per_cent_of_what_has_many_steps(capsys: pytest.CaptureFixture[str]):
    now = [0.0]
    told = PlainProgress(clock=lambda: now[0])
    for now[0] in (0.0, 20.0):
        told("simulations", int(6 * now[0]), 25872)
    assert capsys.readouterr().err == "simulations: 0.4 %, about 72 min left\n"


def test_a_step_that_outlasts_the_time_left_is_told_as_going_on(capsys: pytest.CaptureFixture[str]):
    """The time left counts down while nothing is reported; it does not grow."""
    now = [0.0]
    told = PlainProgress(clock=lambda: now[0])
    for now[0] in (0.0, 30.0):
        told("simulations", int(now[0]), 50)
    for now[0] in (40.0, 61.0):
        told.again()
    assert capsys.readouterr().err.splitlines() == [
        "simulations: 60 %, about 20 s left",
        "simulations: 60 %, about 10 s left",
        "simulations: still at it, 61 s so far",
    ]

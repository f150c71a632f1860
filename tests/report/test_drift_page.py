"""What the page of a drift draws: a square for each tested cell, at its place, as dark as its shift is large."""

import re

import made_up_drift
import pytest

from dynreg.report.drift import cells
from dynreg.report.drift import page as drift_page
from dynreg.report.html import page


def test_squares_stand_where_their_speeds_are() -> None:
    result = made_up_drift.drift()
    maps = drift_page(result)["maps"]
    assert [m.title for m in maps] == ["to the right", "ahead", "turned left"]
    for drawn in maps:
        assert len(drawn.squares) == len(result.cells)
        for square, c in zip(drawn.squares, result.cells, strict=True):
            assert 0 <= square.x <= 95 and 0 <= square.y <= 95
            column, row = round(square.x / drawn.size), round((100 - square.y) / drawn.size) - 1
            assert c.left == pytest.approx(-0.315 + 0.0315 * (column + 0.5))
            assert c.right == pytest.approx(-0.315 + 0.0315 * (row + 0.5))  # the faster, the higher


def test_shades_follow_the_shift_and_marks_the_rejections() -> None:
    first, second, third, _ = drift_page(made_up_drift.drift())["maps"][1].squares
    assert (first.shade, first.rejected) == (-4, True) and second.rejected
    assert (third.shade, third.rejected) == (1, False)
    assert "-6.00 +- 0.50 * mm" in first.label and "left -0.236, right +0.173" in first.label


@pytest.mark.parametrize("verdict", ["moved", "still true", "too little data"])
def test_every_verdict_has_a_page(verdict: str) -> None:
    text = page(made_up_drift.drift(verdict))
    assert f"<b>{verdict}</b>" in text and "friday" in text and "monday" in text
    assert text.count("<rect") == (0 if verdict == "too little data" else 12)
    assert text.count("<circle") == (4 if verdict == "moved" else 0)
    assert "<script" not in text and not re.search(r"(src|href)=", text)


def test_rivals_are_named_with_the_commands_that_tell_them_apart() -> None:
    text = page(made_up_drift.drift(rivals=("left wheel", "all speeds")))
    assert "To tell left wheel from all speeds, record left +0.19, right +0.19 m/s" in text
    assert 'class="chosen">left wheel' not in text
    assert 'class="chosen">left wheel' in page(made_up_drift.drift())


def test_a_factor_at_a_bound_is_marked_and_an_axis_without_a_test_is_left_open() -> None:
    result = made_up_drift.drift()
    best, *others = result.patterns
    ended = best.model_copy(update={"factor": 5.0, "high": 5.0, "at_bound": True})
    first, *rest = result.cells
    partly = first.model_copy(update={"shifts": {"dy": first.shifts["dy"]}})
    made = result.model_copy(update={"patterns": (ended, *others), "cells": (partly, *rest)})
    assert page(made).count("(at a bound)") == 1 and "(at a bound)" not in page(result)
    assert "left wheel x 5.000 [0.799, 5.000], at a bound of the search" in page(made)
    assert cells(partly) == ("-", "-6.00 +- 0.50 *", "-")

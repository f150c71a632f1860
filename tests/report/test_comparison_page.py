"""What the page of a comparison draws, and the geometry of paths seen from above."""

import re

import made_up_comparison
import pytest

from dynreg.report.comparison import page as comparison_page
from dynreg.report.html import page
from dynreg.report.plan import MARGIN, SIZE, plan
from dynreg.results import Comparison, Errors


def points(path: str) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path)]


def test_a_plan_has_one_scale_and_stays_in_its_box() -> None:
    found = plan(
        "ways", [("measured", ([0.0, 2.0, 2.0], [0.0, 0.0, 1.0])), ("model-0", ([0.0, 1.0], [0.0, 0.0]))]
    )
    (first, second, third), (_, short) = (points(line.path) for line in found.lines)
    assert (
        second[0] - first[0]
        == pytest.approx(2 * (second[1] - third[1]), abs=0.2)
        == pytest.approx(SIZE * (1 - 2 * MARGIN), abs=0.2)
    )
    assert short[0] - first[0] == pytest.approx(0.5 * (second[0] - first[0]), abs=0.2)
    assert found.begin == pytest.approx(first, abs=0.1)
    assert all(0 <= value <= SIZE for point in (first, second, third) for value in point)
    metres = {"50 cm": 0.5, "1 m": 1.0}[found.bar_label]
    assert found.bar == pytest.approx(100 * (1 - 2 * MARGIN) * metres / 2)


def test_points_that_were_not_measured_are_left_out_and_nothing_gives_no_plan() -> None:
    (line,) = plan("", [("measured", ([0.0, None, 1.0], [0.0, 1.0, 1.0]))]).lines
    assert len(points(line.path)) == 2 and line.path.count("M") == 2  # and no line is drawn over the gap
    assert plan("", [("measured", ([0.0, None], [0.0, 1.0]))]) is None
    assert plan("", [("measured", ([1.0, 1.0], [2.0, 2.0]))]) is not None  # a robot that stood still


def test_models_stand_in_the_order_in_which_they_were_asked_for() -> None:
    """Also after a trip through a store that sorts keys."""
    result = made_up_comparison.comparison()
    of = result.commands
    models = dict(sorted(of.errors.models.items()))
    stored = _with_errors(result, of.errors.model_copy(update={"models": models}))
    found = comparison_page(stored)
    assert list(found["styles"]) == list(made_up_comparison.NAMES)
    assert [name for name, *_ in found["bars"][0]["rows"]] == list(made_up_comparison.NAMES)
    assert [bar["axis"] for bar in found["bars"]] == ["dx", "dy", "dtheta"]
    assert page(stored) == page(result)


def _with_errors(result: Comparison, errors: Errors) -> Comparison:
    return result.model_copy(update={"commands": result.commands.model_copy(update={"errors": errors})})


def test_an_infinite_ratio_of_variances_is_called_so() -> None:
    result = made_up_comparison.comparison()
    errors = result.commands.errors
    first, *rest = errors.variance
    variance = (first.model_copy(update={"f": None, "p": 0.0}), *rest)
    changed = _with_errors(result, errors.model_copy(update={"variance": variance}))
    assert "F(3, 156) = infinite, p &lt; 0.001" in page(changed)


def test_every_model_is_drawn_in_every_path() -> None:
    result = made_up_comparison.comparison()
    html = page(result)
    drawings = re.findall(r'<svg viewBox="0 0 1000 1000".*?</svg>', html, flags=re.DOTALL)
    assert len(drawings) == len(result.commands.driven) == 2
    for drawing in drawings:
        assert re.findall(r"s-([\w-]+)", drawing) == ["measured", "model-0", "model-1", "model-2", "model-3"]
    assert "command_delay" in html and "&lt; 0.001" in html


def test_a_robot_without_wheels_has_its_errors_their_ties_and_its_traces_on_the_page() -> None:
    result = made_up_comparison.arm()
    html = page(result)
    assert "extended ab12ab12 errs least: 50 [45, 55] % less than nominal" in html
    drawings = re.findall(r'<svg viewBox="0 0 1000 100" .*?</svg>', html, flags=re.DOTALL)
    drawn = [re.findall(r"s-([\w-]+)", drawing) for drawing in drawings]
    models = ["model-0", "model-1", "model-2"]
    assert drawn == [["measured", *models], models, models, models], "a trace, then errors against horizons"
    assert html.count("; tie<") == 3 and "run_2[1]" in html and "commands to test" not in html


def test_a_channel_that_only_short_rollouts_have_is_shown_without_an_error_in_the_long_ones() -> None:
    """A sensor that gave out early ended the tables, the page and the plot."""
    from rich.console import Console

    from dynreg.report.comparison import tables

    whole = made_up_comparison.comparison()
    found = whole.rollouts
    kept = tuple(s for s in found.scores if (s.channel, s.seconds) != ("base/y", found.horizons[-1].seconds))
    cut = whole.model_copy(update={"rollouts": found.model_copy(update={"scores": kept})})
    with (out := Console(width=120)).capture() as shown:
        out.print(tables(cut))
    (row,) = [line.split() for line in shown.get().splitlines() if line.split()[:1] == ["base/y"]]
    assert row == ["base/y", "rad", "-", "-"]
    assert "base/x" in page(cut) and "base/y [rad]" in page(cut)
    (axes,) = cut.plot("base/y")
    assert len(axes.containers) == len(found.names)

"""Geometry of the charts of a page."""

import pytest

from dynreg.report.drawing import chart


@pytest.mark.parametrize(
    "far, step, labels",
    [
        (0.0, 1.0, ["0", "1", "2", "3", "4"]),
        (4_400_000.0, 0.5, ["4400000", "4400000.5", "4400001", "4400001.5", "4400002"]),
        (-4_400_000.0, 0.5, ["-4400000", "-4399999.5", "-4399999", "-4399998.5", "-4399998"]),
        (999_996.0, 1.0, ["999996", "999997", "999998", "999999", "1000000"]),
    ],
)
def test_ticks_far_from_zero_are_told_apart(far: float, step: float, labels: list[str]) -> None:
    """A channel in coordinates of a map lies millions of metres from zero."""
    values = [far + step * i for i in range(5)]
    drawn = chart("base/x [m]", "time [s]", [0.0, 1.0, 2.0, 3.0, 4.0], {"measured": values})
    assert [tick.label for tick in drawn.y_ticks] == labels


@pytest.mark.parametrize("values", [[0.0, 1e-16, 0.0], [1.0, 1.0 + 2e-13, 1.0], [1e16, 1e16 + 4.0, 1e16]])
def test_a_curve_that_moves_by_rounding_alone_is_drawn(values: list[float]) -> None:
    """An axis that nothing drives moves by 1e-17 m: its ticks were equal, and the whole page failed."""
    drawn = chart("base/y [m]", "time [s]", [0.0, 1.0, 2.0], {"measured": values})
    assert len(drawn.y_ticks) > 0

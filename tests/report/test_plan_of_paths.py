"""Paths from above: the bar for scale is a round length, whatever the paths' size."""

import numpy as np
import pytest

from dynreg.report.plan import MARGIN, plan


@pytest.mark.parametrize("side", [*np.geomspace(0.012, 400.0, 60), 0.25, 0.5, 1.05, 2.5])
def test_the_bar_is_a_round_length_of_a_sixth_to_two_fifths_of_the_side(side: float):
    found = plan("way", [("measured", ([0.0, side], [0.0, 0.3 * side]))])
    number, unit = found.bar_label.split()
    length = float(number) * {"m": 1.0, "cm": 0.01}[unit]
    assert f"{float(number):.3e}"[:5] in ("1.000", "2.000", "5.000")
    assert found.bar == pytest.approx(100.0 * (1.0 - 2.0 * MARGIN) * length / side)
    assert 0.159 * side < length <= 0.4 * side * (1 + 1e-9)


def test_a_path_of_one_point_is_no_drawing():
    assert plan("still", [("measured", ([0.0], [0.0]))]) is None

"""Derivatives: differences to both sides, or to one in turn, within bounds; and where they tell nothing."""

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain, sizes_of, with_effect
from legs import over_its_stop

from dynreg.evidence.accuracy import NAMEPLATE, ROUGH, STEP, Accuracy
from dynreg.evidence.lockstep import Ask, run
from dynreg.evidence.model import Model
from dynreg.evidence.point import bounds
from dynreg.evidence.slopes import ROOM, sensitivities, slopes, uneven

STANDING = Accuracy(4.0, fine=True, slopes=2.0, width=ROUGH, nominal=ROUGH, sides=2)
NAME = "zero_offset"


def derivative(model: Model, z: float, side: int = 0, scale: float = 1.0) -> float:
    """Of a residual that is scale * z^3 with the finer time step of derivatives, and z^2 with any other."""
    _, data = held_against_zero(NAME)
    sample = data.sample(data.fit)
    finely = next(model.fine.sloped.residuals([plain(0.0)], sample))[0].robot

    def answer(one: Ask) -> np.ndarray:
        at = model.coordinates.from_values(one.case.values)[:, 0]
        power = 3 if one.robot is finely else 2
        return first_channel(one, scale * at[:, None, None] ** power)

    (slope,) = answered(slopes(model.fine, [plain(z)], sample, side=side), answer)
    assert np.ptp(slope) < 1e-9 * max(abs(slope.flat[0]), 1.0)
    return float(slope.flat[0]) / scale


def reach(tolerance: float = 10.0) -> tuple[Model, float, float]:
    """A model whose derivatives are to one side, and the bounds of its only coordinate."""
    model, _ = held_against_zero(NAME, accuracy=STANDING, tolerance=tolerance)
    (limits,) = bounds(model.coordinates, plain(0.0).hypothesis)
    return model, *limits


ENDS = {
    "towards the nameplate from it": lambda low, high: (0.0, 0, ROUGH),
    "away from it": lambda low, high: (0.0, 1, -ROUGH),
    "towards": lambda low, high: (1.0, 0, 1.0 - ROUGH),
    "towards from below": lambda low, high: (-1.0, 0, -1.0 + ROUGH),
    "away": lambda low, high: (0.7, 1, 0.7 + ROUGH),
    "at its bound": lambda low, high: (high, 1, high - ROUGH),
    "too near to it": lambda low, high: (high - ROUGH * ROOM + 0.01, 1, high - ROUGH * (ROOM + 1.0) + 0.01),
    "a narrow difference up to it": lambda low, high: (high - ROUGH * ROOM - 0.01, 1, high),
}


@pytest.mark.parametrize("case", ENDS.values(), ids=ENDS)
def test_derivatives_of_a_robot_on_its_feet_are_differences_to_one_side(case):
    model, low, high = reach()
    z, side, end = case(low, high)
    assert low + ROUGH < 0.0 < high - 1.8 * ROUGH, "there is room for what is asked"
    assert derivative(model, z, side, scale=0.001) == pytest.approx((end**3 - z**3) / (end - z))


def test_between_narrow_bounds_the_difference_is_to_the_farther_one():
    model, low, high = reach(tolerance=60.0)
    z = low + 0.8 * (high - low)
    assert high - low < ROUGH
    assert derivative(model, z) == pytest.approx((z**3 - low**3) / (z - low))


def test_others_take_both_sides():
    model, _ = held_against_zero(
        NAME, accuracy=Accuracy(8.0, fine=True, slopes=8.0, width=ROUGH, nominal=ROUGH)
    )
    for side in (0, 1):
        assert derivative(model, 1.0, side, scale=0.001) == pytest.approx((2.0**3 - 0.0) / 2.0)


def test_leading_derivatives_are_taken_as_they_are():
    model, data = held_against_zero(NAME, "resistance")
    sample = data.sample(data.fit)
    known = np.full((1, len(data.fit), 40, 1), 7.0)

    def answer(one: Ask) -> np.ndarray:
        return first_channel(
            one, (model.coordinates.from_values(one.case.values) @ [0.1, 0.2])[:, None, None]
        )

    ((all_, given),) = answered(slopes(model, [plain(0.3, -0.3)], sample, known), answer)
    assert (all_ == 7.0).all() and given == pytest.approx(np.full_like(given, 0.2))
    (residual,), (slope,) = answered(sensitivities(model, [plain(0.3, -0.3)], sample), answer)
    assert residual == pytest.approx(np.full_like(residual, -0.03))
    assert slope[:, 0, 0, 0] == pytest.approx([0.1, 0.2])


def test_nominal_coordinates_are_moved_by_half_a_standard_deviation_and_sizes_by_little():
    """What a tenth of that changes of a weak parameter is where dry friction lets go by chance."""
    model, data = held_against_zero(NAME)

    def answer(one: Ask) -> np.ndarray:
        z = model.coordinates.from_values(one.case.values)[:, 0]
        size = sizes_of(model, one, "coulomb_friction") - 1.0
        return first_channel(one, (0.01 * (z**3 + size**3))[:, None, None])

    point = with_effect("coulomb_friction", 0.0)
    ((nominal, size),) = answered(slopes(model, [point], data.sample(data.fit)), answer)
    assert nominal[0, 0, 0] == pytest.approx(0.01 * NAMEPLATE**2) and NAMEPLATE == 0.5
    assert size[0, 0, 0] == pytest.approx(0.01 * STEP**2)


@pytest.mark.parametrize(("height", "rough"), [(0.5, False), (0.2, True)])
def test_rollouts_are_rough_where_the_foot_touches_the_ground(height: float, rough: bool):
    model, data, _ = over_its_stop(height)
    assert run(uneven(model, model.start, data.sample(data.fit))) is rough

"""Parameters of a cause: their units where they act, their values, intervals and bounds."""

import numpy as np
import pytest
from by_hand import with_effect

from dynreg.evidence.estimate import Estimate, estimates
from dynreg.evidence.hypothesis import Coordinates, effect_bounds
from dynreg.evidence.interval import Posterior
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.known import nominal_known
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot


def told(robot: Robot, key: str, size: float = 1.0, spread: float = 0.1, **how) -> dict[str, Estimate]:
    """The parameters of an effect that draws from `spread` below its size to as much above it tell."""
    model = Model(robot, Coordinates(robot, nominal_known(robot)))
    point = with_effect(key, *np.zeros(len(model.coordinates)), size=size)
    z = np.tile(point.z, (101, 1))
    z[:, len(point.nominal)] += np.linspace(-spread, spread, 101)
    draws = Posterior(point.hypothesis, z, np.full(101, 1 / 101), 1.0, 1.0)
    return estimates(model, point, 0, draws, **how)


@pytest.mark.parametrize(
    ("name", "key", "units"),
    [
        ("husky", "rate_limit", ["m/s^2 or rad/s^2"]),
        ("husky", "command_deadband", ["m/s or rad/s"]),
        ("diffdrive", "rate_limit", ["rad/s^2"]),
        ("diffdrive", "command_deadband", ["rad/s"]),
        ("servo_pendulum", "coulomb_friction", ["N*m"]),
        ("emps", "coulomb_friction", ["N"]),
        ("emps", "command_delay", ["s"]),
        ("leg", "coulomb_friction[knee]", ["N*m"]),
    ],
)
def test_sizes_have_the_units_of_where_they_act(name: str, key: str, units: list[str]):
    assert [one.unit for one in told(load_robot(name), key).values()] == units


def test_an_interval_is_that_of_the_draws_and_holds_the_value():
    (one,) = told(load_robot("servo_pendulum"), "coulomb_friction").values()
    weak, medium, strong = one.sizes
    assert one.value == pytest.approx(medium) and weak < medium < strong and not one.at_bound
    assert (one.low, one.high) == pytest.approx((0.91 * medium, 1.09 * medium), rel=0.01)
    (off,) = told(load_robot("servo_pendulum"), "coulomb_friction", spread=-0.0).values()
    assert off.low == off.value == off.high


def test_along_a_valley_the_middle_of_the_draws_is_told():
    robot = load_robot("servo_pendulum")
    model = Model(robot, Coordinates(robot, nominal_known(robot)))
    point = with_effect("coulomb_friction", *np.zeros(len(model.coordinates)))
    z = np.tile(point.moved(2.0 * point.z).z, (9, 1))
    draws = Posterior(point.hypothesis, z, np.full(9, 1 / 9), 1.0, 1.0)
    (best,) = estimates(model, point, 0, draws).values()
    (middle,) = estimates(model, point, 0, draws, median=True).values()
    assert middle.value == pytest.approx(2.0 * best.value) and best.low == best.value


def test_what_a_fit_cannot_leave_is_at_its_bound():
    robot = load_robot("servo_pendulum")
    hypothesis = with_effect("coulomb_friction").hypothesis
    (most,) = effect_bounds(hypothesis)[:, 1]
    (one,) = told(robot, "coulomb_friction", size=most, spread=0.0).values()
    (within,) = told(robot, "coulomb_friction", size=0.5 * most, spread=0.0).values()
    assert one.at_bound and not within.at_bound


def test_sizes_return_from_their_values():
    """Inverse sizes and shapes, too."""
    robot = load_robot("leg")
    c = Coordinates(robot, nominal_known(robot))
    for key in ("speed_limit", "stribeck_friction[knee]", "joint_elasticity[knee]", "command_delay"):
        z = np.full(len(term(key).effect.parameters), 0.5)
        point = Point(with_effect(key).hypothesis, np.zeros(len(c)), z)
        (values,) = c.effect_values(point.hypothesis, z[None])
        assert c.effect_coordinates(term(key), values[0]) == pytest.approx(z)

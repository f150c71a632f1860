"""An answer fitted to each of several recordings: the nameplate pulls at no difference between them."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.refit import refits
from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot, load_robot

MOVED = 0.03  # rad: nine times the nameplate's tolerance of the zero, and hundreds of times that of its fitted value


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def test_a_value_that_differs_by_many_tolerances_is_found_to_differ(robot: Robot) -> None:
    """Its nominal value is 0: a tolerance relative to the answer's own small value held the other one there."""
    before = hide(robot, (), None, 11)
    at, values = robot.space.names.index("zero_offset"), before.parameters.copy()
    values[at] += MOVED
    logs = {
        name: log_of(robot, hidden, protocol(robot, seed=seed, seconds=12.5), engine="joint")
        for name, hidden, seed in (("a", before, 1), ("b", replace(before, parameters=values), 2))
    }
    answer = SimConfig.of(robot, values)
    found = run(refits(robot, logs, DiagnosisOptions(threads=1), answer, 20.0), threads=1)
    (offset,) = [one for one in found.each if not one.same]
    assert offset.parameter == "zero_offset" and offset.nats > 100
    apart = offset.values["b"].value - offset.values["a"].value
    assert apart == pytest.approx(MOVED, rel=0.1)
    assert offset.values["a"].value == pytest.approx(before.parameters[at], abs=0.002)
    for left in found.left.values():
        assert 0 < left.residual < 3 * left.noise


def test_a_tolerance_is_of_the_nominal_value_wherever_the_centre_is(robot: Robot) -> None:
    known = np.full(len(robot.space), np.nan)
    values = robot.space.nominal.copy()
    at = robot.space.names.index("zero_offset")
    values[at] = 0.001
    usual, moved = Coordinates(robot, known), Coordinates(robot, known, values)
    assert moved.sigma[at] == usual.sigma[at] == pytest.approx(0.02 * 0.16)


def test_coordinates_about_another_centre_lie_in_those_about_the_first(robot: Robot) -> None:
    known = np.full(len(robot.space), np.nan)
    first = Coordinates(robot, known, tolerance=5.0)
    other = first.about(1.1 * robot.space.nominal + 0.01)
    begin, step = other.within(first)
    z = np.random.default_rng(0).normal(0.0, 0.1, len(first))
    np.testing.assert_allclose(first.values(begin + step * z), other.values(z), rtol=1e-12)

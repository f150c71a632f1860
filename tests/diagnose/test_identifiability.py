"""What a recording already holds is not asked for; what it does not tell is said."""

import numpy as np
import pytest

from dynreg.diagnose.identifiability import Unidentified, same_as_parameters, unidentified
from dynreg.diagnose.measured import measured_effects
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.evidence.point import Point
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.results.diagnosis import Pulled
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.diagnosis_words import identifiability_words, same_words


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def covariance_of(coordinates: Coordinates, wide: dict[str, float], deviation: float, rest: float = 0.05):
    """(P', P') covariance with the prior: the recording tells `deviation` along a direction, `rest` across it."""
    names = [p.name for p in coordinates.robot.space.parameters]
    direction = np.array([wide.get(names[i], 0.0) for i in coordinates.free])
    direction /= np.linalg.norm(direction)
    along = np.outer(direction, direction)
    told = (np.eye(len(direction)) - along) / rest**2 + along / deviation**2
    return np.linalg.inv(told + np.eye(len(direction)))


def words(coordinates: Coordinates, covariance: np.ndarray) -> tuple[str, ...]:
    return said_of(coordinates.robot, unidentified(coordinates, covariance))


def said_of(robot: Robot, found: Unidentified) -> tuple[str, ...]:
    """What is said where every parameter was fitted to its nominal value."""
    fitted = {
        p.name: Pulled(
            value=p.nominal,
            low=p.low,
            high=p.high,
            unit=p.unit,
            nominal=p.nominal,
            at_bound=False,
            pulled_sigma=0.0,
        )
        for p in robot.space.parameters
    }
    return identifiability_words(robot, found, fitted)


@pytest.fixture
def coordinates(robot: Robot) -> Coordinates:
    return Coordinates(robot, np.full(len(robot.space), np.nan))


def test_only_a_supply_that_was_measured_while_the_robot_moved_holds_its_sag(robot: Robot):
    recording = log_of(robot, hide(robot, (), None, 3), protocol(robot, seconds=12.5))
    windows = pose(robot, recording, DiagnosisOptions())[1].windows
    assert measured_effects(robot, windows) == {}  # one level an episode
    supply = robot.inputs.index("supply")
    windows.run.inputs[0, 5:, supply] -= 0.3
    assert measured_effects(robot, windows) == {"voltage_sag": "supply"}


def test_a_parameter_of_which_the_recording_says_nothing_is_not_told(coordinates: Coordinates):
    found = unidentified(coordinates, covariance_of(coordinates, {"resistance": 1.0}, 100.0))
    assert found == Unidentified(("resistance",), ())
    assert "does not identify resistance:" in said_of(coordinates.robot, found)[0]


def test_a_parameter_that_a_tight_nameplate_holds_is_told_as_that(coordinates: Coordinates):
    """The mass is stated to 1 %; the recording tells it to 3 %, which is no small thing."""
    found = unidentified(coordinates, covariance_of(coordinates, {"tip_mass": 1.0}, 3.0))
    assert found.alone == () and found.together == ()
    ((name, ratio),) = found.held
    assert name == "tip_mass" and ratio == pytest.approx(3.0, rel=0.05)
    (said,) = said_of(coordinates.robot, found)
    assert said.startswith("robot.toml states tip_mass 2.9 times more exactly than the recording tells")


def test_parameters_that_scale_together_are_told_with_their_signs(coordinates: Coordinates):
    # the same factor on each: the mass is known to 2 %, friction to 10 %
    wide = {"tip_mass": 1 / 0.02, "coulomb_friction": 1 / 0.1, "resistance": -1 / 0.05}
    (said,) = words(coordinates, covariance_of(coordinates, wide, 100.0))
    assert said.startswith(
        "the motion hardly changes when tip_mass, coulomb_friction grow and resistance shrinks: "
    )


def test_a_known_mass_is_advised_to_robots_that_have_masses(coordinates: Coordinates):
    base = load_robot("diffdrive")
    wheels = Coordinates(base, np.full(len(base.space), np.nan))
    (said,) = words(wheels, covariance_of(wheels, {"wheel_radius": 1.0, "speed_drag": 1.0}, 100.0))
    assert said.endswith("Measure one of them")
    (said,) = words(coordinates, covariance_of(coordinates, {"tip_mass": 2.0, "resistance": 1.0}, 100.0))
    assert said.endswith("or add a known mass in some runs")


def test_nothing_is_said_where_everything_is_told(coordinates: Coordinates):
    assert unidentified(coordinates, covariance_of(coordinates, {"tip_mass": 1.0}, 0.3)) == Unidentified(
        (), ()
    )


def test_an_effect_that_does_the_same_as_a_parameter_is_told():
    """The prior of the parameter makes a value of both; the data have one slope for them."""
    point = Point(Hypothesis((term("payload"),)), np.zeros(2), np.zeros(1))
    slopes = np.array([[30.0, 0.1], [0.0, 20.0], [50.0, 0.0]])  # of mass and friction, and of the payload
    curvature = slopes @ slopes.T + np.diag(point.prior)
    pairs = same_as_parameters(point, ("base_mass", "friction"), curvature)
    assert pairs == (("payload", "base_mass"),)
    (said,) = same_words(pairs)
    assert (
        said.startswith("the effect payload and the parameter base_mass do the same")
        and "--without payload" in said
    )
    begun = Point(Hypothesis((term("payload"),), given=1), point.nominal, point.effect)
    assert same_as_parameters(begun, ("base_mass", "friction"), curvature) == ()
    slopes[0, 1] = 10.0  # they differ by an angle of 18 degrees
    assert (
        same_as_parameters(point, ("base_mass", "friction"), slopes @ slopes.T + np.diag(point.prior)) == ()
    )

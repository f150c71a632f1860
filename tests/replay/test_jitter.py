"""Motor noise is read off what the best simulator leaves from row to row; what the log does not tell is left alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.diagnose.account import simulator
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.jitter import jitter
from dynreg.sim.effects import Terms, term
from dynreg.sim.excitation import reset_pose
from dynreg.sim.real import Budget, SimulatedRobot
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.space import ParameterSpace
from dynreg.verbs.diagnosis import parameters

TRUE = 0.03  # rad
OPTIONS = DiagnosisOptions(threads=1)


def standing(robot: Robot, noise: float, effects: dict[str, tuple[float, ...]]) -> tuple[Model, Data]:
    """Three short logs of a robot that sways on its feet, with this motor noise and these effects, posed."""
    values = robot.space.from_dict({"motor_noise": noise, "torque": 2.0})
    terms = tuple(map(term, effects))
    real = SimulatedRobot(
        robot, values, terms, tuple(map(np.array, effects.values())), seed=4, budget=Budget(trials=3)
    )
    t = np.arange(60)[:, None] / robot.rate
    straight = {
        "_shoulder": -0.3,
        "_elbow": 0.7,
    }  # more so than in the stance, where two legs cannot carry it
    up = np.array([next((v for part, v in straight.items() if part in a), 0.0) for a in robot.actions])
    sway = 0.05 * np.sin(2 * np.pi * np.array([[0.9], [1.4], [1.9]])[:, None] * t)
    pose_at = reset_pose(robot) + np.minimum(t / 0.4, 1.0) * up
    logs = [real.run(pose_at + s, robot.rate, f"sway_{i}").recording for i, s in enumerate(sway)]
    apart = 61 / robot.rate
    episodes = tuple(
        replace(log.episodes[0], time=log.episodes[0].time + i * apart) for i, log in enumerate(logs)
    )
    return pose(robot, replace(logs[0], episodes=episodes), OPTIONS)


@pytest.fixture(scope="module")
def quadruped() -> Robot:
    return load_robot("quadruped")


def told(robot: Robot, data: Data, values: np.ndarray, terms: Terms | None = None, **options) -> float:
    at = robot.space.names.index("motor_noise")
    found, ran = jitter(robot, data.windows, values, terms, data.parts.chosen, **options)
    assert ran in (5, 10, 15), "all rounds that were run count"
    others = np.arange(len(values)) != at
    assert np.array_equal(found[others], values[others])
    return float(found[at])


@pytest.mark.parametrize("noise", [0.01, TRUE])
def test_the_noise_of_the_commands_is_found_by_a_simulator_that_is_a_little_off(
    quadruped: Robot, noise: float
) -> None:
    _, data = standing(quadruped, noise, {})
    near = quadruped.space.from_dict(
        {"torque": 2.1, "torso_mass": 1.03 * quadruped.space.as_dict(quadruped.space.nominal)["torso_mass"]}
    )
    found = told(quadruped, data, near)
    assert found == pytest.approx(noise, rel=0.25)
    assert told(quadruped, data, near) == found  # the same draws again
    assert told(quadruped, data, near, seed=1) != found


def test_without_noise_next_to_none_is_found(quadruped: Robot) -> None:
    _, data = standing(quadruped, 0.0, {})
    assert told(quadruped, data, quadruped.space.from_dict({"torque": 2.0})) < 0.004


def test_the_simulator_of_a_point_has_its_effects_and_the_noise_that_they_leave(quadruped: Robot) -> None:
    """Friction in the joints swallows half of the noise: who leaves it out takes the noise for smaller."""
    model, data = standing(quadruped, TRUE, {"coulomb_friction": (0.3,)})
    coordinates = model.coordinates
    friction = term("coulomb_friction")
    point = Point(Hypothesis((friction,)), np.zeros(len(coordinates)), np.ones(1))
    values, terms = simulator(model, data, point, OPTIONS)
    size = coordinates.effect_values(point.hypothesis, point.effect[None])[0]
    assert [t.key for t in terms.terms] == ["coulomb_friction"] and np.array_equal(terms.values[0], size)
    at = quadruped.space.names.index("motor_noise")
    with_it = told(quadruped, data, values, Terms((friction,), (np.array([[0.3]]),)))
    assert abs(with_it - TRUE) < abs(told(quadruped, data, values) - TRUE)
    assert values[at] == told(quadruped, data, values, terms) != coordinates.values(point.nominal)[at]
    bare = replace(point, hypothesis=Hypothesis(), effect=np.zeros(0))
    plain, none = simulator(model, data, bare, OPTIONS)
    assert none is None and plain[at] == told(quadruped, data, plain)
    draws = SimpleNamespace(z=np.zeros((2, len(coordinates))), quantiles=lambda x: (x.min(0), x.max(0)))
    seen = SimpleNamespace(draws=draws, simulators={"calibrated": (values, None)}, shares=None)
    row = parameters(model, point, seen)["motor_noise"]  # the result tells what the simulator has
    assert row.value == values[at] != row.nominal and row.low is None and row.high is None  # not fitted


def test_more_noise_than_the_range_holds_ends_at_its_bound_and_still_robots_tell_nothing(
    quadruped: Robot,
) -> None:
    _, data = standing(quadruped, 0.05, {})
    values, at = quadruped.space.from_dict({"torque": 2.0}), quadruped.space.names.index("motor_noise")
    narrow = replace(quadruped.space.parameters[at], high=0.02)
    parameters = (*quadruped.space.parameters[:at], narrow, *quadruped.space.parameters[at + 1 :])
    robot = replace(quadruped, space=ParameterSpace(parameters))
    assert told(robot, data, values) == 0.02
    unweighted = replace(data.windows, weight=0.0 * data.windows.weight)
    assert told(robot, replace(data, windows=unweighted), values) == values[at]


def test_a_robot_without_motor_noise_keeps_itsparameters() -> None:
    servo = load_robot("servo_pendulum")
    values = servo.space.nominal
    found, ran = jitter(servo, None, values, None, None)
    assert found is values and ran == 0

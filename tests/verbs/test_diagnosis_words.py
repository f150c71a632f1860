"""What a diagnosis is asked for first, and what its notes say of parameters at an edge."""

import pytest

from dynreg.results.diagnosis import Pulled
from dynreg.sim.robot import load_robot
from dynreg.verbs.diagnose import first_command
from dynreg.verbs.diagnosis_words import at_the_edge


@pytest.mark.parametrize(
    "robot, asked",
    [
        ("servo_pendulum", "dynreg diagnose sway"),
        ("double_pendulum", "dynreg diagnose sway"),
        ("husky", "dynreg diagnose sway"),
        ("so101", "dynreg diagnose sway --windows 8 --threshold-runs 0"),
        ("quadruped", "dynreg diagnose sway --windows 8 --threshold-runs 0"),
    ],
)
def test_the_first_diagnosis_of_many_joints_or_a_free_base_is_the_quick_one(robot: str, asked: str) -> None:
    assert first_command("sway", load_robot(robot)) == asked


def at(value: float, low: float, high: float) -> Pulled:
    return Pulled(
        value=value, low=value, high=value, unit="1", nominal=1.0, at_bound=True, limits=(low, high)
    )


def test_no_wider_range_is_asked_for_below_nothing() -> None:
    (said,) = at_the_edge(
        {"friction": at(1e-9, 0.0, 2.0), "damping": at(2.0, 0.0, 2.0), "mass": at(0.5, 0.5, 2.0)}
    )
    assert said.startswith(
        "damping, mass are at the edge of the allowed range: widen the range in robot.toml"
    )
    assert not [*at_the_edge({"friction": at(0.0, 0.0, 2.0)})]

"""What a diagnosis is asked for first, and what its notes say of parameters at an edge."""

import warnings
from pathlib import Path

import pytest

from dynreg.diagnose.identifiability import Unidentified
from dynreg.errors import Assumed
from dynreg.evidence import model
from dynreg.results.diagnosis import Pulled
from dynreg.sim.robot import load_robot
from dynreg.verbs.diagnose import MANY, DiagnoseSettings, _tell_longer, faster, first_command
from dynreg.verbs.diagnosis_words import at_the_edge, identifiability_words, threshold_note, zeros_moved
from dynreg.verbs.robots import robot_copy


@pytest.mark.parametrize(
    "robot, asked",
    [
        ("servo_pendulum", "dynreg diagnose sway"),
        ("double_pendulum", "dynreg diagnose sway"),
        ("husky", "dynreg diagnose sway"),
        ("so101", "dynreg diagnose sway --windows 4 --horizon 2 --max-causes 1 --threshold-runs 0"),
        ("quadruped", "dynreg diagnose sway --windows 8 --threshold-runs 0"),
    ],
)
def test_the_first_diagnosis_of_many_joints_or_a_free_base_is_the_quick_one(robot: str, asked: str) -> None:
    assert first_command("sway", load_robot(robot)) == asked


def test_no_rollout_of_a_first_look_is_longer_than_the_robot_states(tmp_path: Path) -> None:
    """Drafts of drives that are told torques state 0.5 s: --horizon 2 made rollouts four times as long."""
    robot_copy("so101", tmp_path / "arm")
    file = tmp_path / "arm" / "robot.toml"
    file.write_text(file.read_text().replace("horizon = 5.0", "horizon = 0.5"))
    asked = "dynreg diagnose sway --windows 4 --max-causes 1 --threshold-runs 0"
    assert first_command("sway", load_robot(tmp_path / "arm")) == asked


def test_longer_rollouts_than_the_robot_states_are_told() -> None:
    robot = load_robot("double_pendulum")
    with pytest.warns(Assumed, match="up to 4 times as long as .* 'double_pendulum' .0.5 s.") as told:
        _tell_longer(robot, 2.0)
    (said,) = [str(one.message) for one in told]
    assert said.startswith("a horizon of 2 s makes") and "--" not in said, "it is told in Python, too"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for asked in (None, 0.3):
            _tell_longer(robot, asked)


def test_the_first_diagnosis_of_a_free_base_with_many_parameters_asks_for_no_effect_of_a_joint() -> None:
    assert MANY == model.MANY
    asked = first_command("walks", load_robot("aibo"))
    assert asked.startswith("dynreg diagnose walks --windows 8 --threshold-runs 0 --horizon 2 --effects ")
    effects = asked.split()[-1].split(",")
    assert "second_friction_material" in effects and not {"backlash", "torque_limit"} & {*effects}


@pytest.mark.parametrize(
    "given, said",
    [
        ({}, "--threshold-runs 0, --joints A,B, --effects A,B or --windows 8 make it faster"),
        ({"threshold_runs": 0, "windows": 4}, "--joints A,B or --effects A,B make it faster"),
        ({"threshold_runs": 0, "windows": 20}, "--joints A,B, --effects A,B or --windows 8 make it faster"),
        ({"threshold_runs": 0, "windows": 8, "joints": ("arm",)}, "--effects A,B makes it faster"),
        ({"threshold_runs": 0, "windows": 8, "joints": ("arm",), "effects": ("backlash",)}, ""),
    ],
)
def test_options_that_were_given_are_not_advised(given: dict, said: str) -> None:
    assert faster(DiagnoseSettings(**given)) == said


def test_a_value_that_the_recording_moved_is_not_said_to_be_that_of_the_nameplate() -> None:
    """Its interval may be as wide as the nameplate's: it moved all the same, and the table says so."""

    def fitted(value: float, nominal: float, pull: float | None) -> Pulled:
        return Pulled(
            value=value, low=0.2, high=0.3, unit="kg", nominal=nominal, at_bound=False, pulled_sigma=pull
        )

    named = {
        "tip": fitted(0.235, 0.189, 2.5),
        "trunk": fitted(0.25, 0.248, 0.1),
        "foot": fitted(0.25, 0.1, None),
    }
    kept, moved = identifiability_words(load_robot("leg"), Unidentified((*named,), ()), named)
    assert (
        kept == "the recording does not identify trunk: its value stays within 1 sigma of that of robot.toml"
    )
    assert moved.startswith("the recording moves tip from 0.189 to 0.235 kg, foot from 0.1 to 0.25 kg, but")


def test_a_wider_range_is_asked_for_at_the_edge_of_one() -> None:
    (said,) = at_the_edge(["damping", "mass"])
    assert said.startswith(
        "damping, mass are at the edge of the allowed range: widen the range in robot.toml"
    )
    assert not [*at_the_edge([])]


def test_a_threshold_of_few_robots_claims_no_rate_of_false_alarms() -> None:
    assert "80 % confidence" in threshold_note([0.0, 3.1, 1.0, 0.2, 0.3, 0.4])
    assert threshold_note([3.14]) == (
        "1 simulated robot without an effect reached at most 3.14 nats under these commands: too few to set one below "
        "the usual 20 nats, which takes 6 of them"
    )


def test_zeros_that_explain_an_error_are_told():
    """ "Nothing is wrong" said no word of them."""
    robot = load_robot("double_pendulum")
    assert list(zeros_moved(robot, {})) == []
    (told,) = zeros_moved(robot, {"shoulder/position": 0.0312, "elbow/position": 0.02})
    assert told.endswith("(shoulder/position by up to 0.031 rad, elbow/position by up to 0.02 rad)")

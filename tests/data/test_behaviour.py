"""Logs of joints that are of no use say so, once for each cause; good ones say nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.behaviour.joint import grain
from dynreg.data.ingest import doctor
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Finding

JOINTS = ("hip", "knee", "ankle")
TIME = np.arange(2000) / 100
Columns = dict[str, np.ndarray]


@pytest.fixture
def legs() -> Columns:
    """Three joints that follow targets of their own 50 ms late, with noise, as a log in which columns name them."""
    rng, out = np.random.default_rng(3), {"time": TIME}
    for number, joint in enumerate(JOINTS):
        steps = np.repeat(rng.uniform(-0.5, 0.5, 20), 100)
        target = steps + 0.3 * np.sin((1.1 + 0.7 * number) * TIME)
        place = np.zeros(len(TIME))
        for k in range(1, len(TIME)):
            place[k] = place[k - 1] + 0.2 * (target[k - 1] - place[k - 1])
        out[f"cmd_{joint}"] = target
        out[f"pos_{joint}"] = place + 2e-4 * rng.standard_normal(len(TIME))
        out[f"vel_{joint}"] = np.gradient(place, TIME) + 2e-3 * rng.standard_normal(len(TIME))
        out[f"effort_{joint}"] = 20 * (target - place) + 0.01 * rng.standard_normal(len(TIME))
    return out


@pytest.fixture
def told(write_table: Callable) -> Callable[[Columns], list[Finding]]:
    """What the doctor says of a table."""
    return lambda columns: [*doctor(write_table(**columns))]


def test_nothing_is_said_of_good_joints(legs: Columns, told: Callable):
    assert told(legs) == []


@pytest.mark.parametrize("quantum", [0.0015, 0.02])
def test_coarse_sensors_noise_and_friction_are_no_finding(legs: Columns, told: Callable, quantum: float):
    """Encoders that flicker, a velocity of steps, a soft drive that droops, and a joint that stands."""
    rng = np.random.default_rng(5)
    for joint in JOINTS:
        place = 0.6 * legs[f"pos_{joint}"] - 0.05 + 0.3 * quantum * rng.standard_normal(len(TIME))
        legs[f"pos_{joint}"] = np.round(place / quantum) * quantum
        legs[f"vel_{joint}"] = np.round(legs[f"vel_{joint}"] / 0.077) * 0.077
    legs["cmd_ankle"] = np.full(len(TIME), 0.3)
    legs["pos_ankle"] = np.round((0.26 + 0.3 * quantum * rng.standard_normal(len(TIME))) / quantum) * quantum
    legs["vel_ankle"] = 0.01 * rng.standard_normal(len(TIME))
    assert told(legs) == []


def test_a_joint_that_chatters(legs: Columns, told: Callable):
    """Also where its effort stands at its limit, which comes of the chatter."""
    swings = np.where(np.arange(len(TIME)) % 2, 1.0, -1.0)
    legs["vel_knee"] += 2.0 * swings
    legs["pos_knee"] += 0.006 * swings
    legs["effort_knee"] = 8.0 * swings
    (found,) = told(legs)
    assert found.check == "chatter" and found.where == "log.csv, knee"
    assert "at about half the sampling rate in 100 % of the log (at 50 Hz of 100 Hz, amplitude" in found.told
    assert "lower kd, or log faster; to use the log as it is, leave it out: weight = 0 of its" in found.told
    assert found.told.endswith("channels in robot.toml, or --joints with the others")


def test_joints_that_are_alike_are_one_finding(legs: Columns, told: Callable):
    for joint in JOINTS:
        legs[f"vel_{joint}"] += 2.0 * np.where(np.arange(len(TIME)) % 2, 1.0, -1.0)
    (found,) = told(legs)
    assert found.where == "log.csv, all 3 joints" and found.told.startswith("oscillate at about")
    assert "leave them out: weight = 0 of their channels" in found.told


def test_an_oscillation_of_which_each_row_shows_the_same_phase(legs: Columns, told: Callable):
    legs["vel_knee"] = 3.0 * np.sign(np.sin(0.9 * TIME)) + 0.1 * legs["vel_knee"]
    (found,) = told(legs)
    assert (
        found.check == "chatter"
        and "the log is aliased" in found.told
        and "has a velocity of 3" in found.told
    )


def test_a_velocity_that_nobody_measured(legs: Columns, told: Callable):
    legs["vel_hip"] = np.zeros(len(TIME))
    legs["vel_knee"] = np.zeros(len(TIME))
    (found,) = told(legs)
    assert (found.check, found.where) == ("velocity", "log.csv, hip and knee")
    assert found.told.startswith("have a velocity of 0 rad/s in all of the log while the position moves")
    assert "derivative_of" in found.told


def test_a_wheel_that_turns_steadily_measures_its_velocity(legs: Columns, told: Callable):
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))
    legs["pos_hip"], legs["vel_hip"] = 0.9 * TIME + noise, np.full(len(TIME), 0.9)
    assert not [found for found in told(legs) if found.check == "velocity"]


def test_a_drive_that_gives_all_it_can(legs: Columns, told: Callable):
    legs["effort_hip"] = np.clip(legs["effort_hip"], -0.6, 0.6)
    (found,) = told(legs)
    assert found.check == "saturation" and found.where == "log.csv, hip"
    assert "at the largest torque, 0.6 N*m, in" in found.told


def test_a_commanded_effort_at_its_limit(legs: Columns, write_table: Callable):
    channels = (
        ChannelSpec("hip/position", "rad", "state"),
        ChannelSpec("hip/torque", "N*m", "action", low=-1, high=1),
    )
    spec, bang = RecordingSpec("leg", channels, (), 100.0), np.sign(np.sin(3 * TIME))
    columns = {"time": TIME, "hip__position": legs["pos_hip"], "hip__torque": bang}
    (found,) = doctor(write_table(**columns), spec)
    assert "at the largest commanded torque, 1 N*m, in 100 % of the moving samples" in found.told
    wide = replace(channels[1], low=-2.0, high=2.0)
    assert not doctor(write_table(**columns), replace(spec, channels=(channels[0], wide)))


def test_a_joint_at_its_stop(legs: Columns, told: Callable):
    legs["pos_knee"] = np.minimum(legs["pos_knee"], 0.1)
    legs["vel_knee"] = np.gradient(legs["pos_knee"], TIME)
    (found,) = told(legs)
    assert found.check == "stop" and found.where == "log.csv, knee" and "stands at 0.1 rad in" in found.told


def bouncing(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """The target of a joint that is told to go far beyond its stops, and how it hits them, bounces and stands."""
    target, place = 1.6 * np.sin(1.3 * TIME) * np.sin(0.11 * TIME + 0.5), np.zeros(len(TIME))
    now = speed = 0.0
    for k in range(len(TIME)):
        for _ in range(20):  # stops that give way: springs far stiffer than the drive
            beyond = now - np.clip(now, low, high)
            speed += 5e-4 * (40.0 * (target[k] - now) - 8.0 * speed - 4e4 * beyond)
            now += 5e-4 * speed
        place[k] = now
    return target, place


@pytest.mark.parametrize(
    ("low", "high", "says"),
    [
        (-0.05, 0.05, "stands at 0.05"),
        (-9.0, 0.05, "stands at 0.05"),
        (-0.05, 9.0, "stands at -0.05"),
    ],
)
def test_a_joint_that_bounces_on_its_stops(told: Callable, low: float, high: float, says: str):
    target, place = bouncing(low, high)
    (found,) = told({"time": TIME, "cmd_knee": target, "pos_knee": place})
    assert found.check == "stop" and says in found.told
    assert ("and at -0.05" in found.told) == ("on both sides" in found.told) == (low > -1 and high < 1)


def test_a_motion_that_its_target_only_scales_or_does_not_reach_is_no_stop(told: Callable):
    """A drive so soft that it goes a tenth of the way; steps of it; and an arm that hangs while its drive is off."""
    rng = np.random.default_rng(7)
    waves, steps = np.sin(1.3 * TIME), np.repeat(rng.choice([-1.0, 1.0], 20), 100)
    hangs = 0.3 * np.exp(-2 * TIME) * np.cos(9 * TIME)
    for target, place in ((waves, 0.1 * waves), (steps, 0.1 * steps), (waves, hangs)):
        noisy = place + 2e-4 * rng.standard_normal(len(TIME))
        found = told({"time": TIME, "cmd_knee": target, "pos_knee": noisy})
        assert not any(one.check == "stop" for one in found)


def test_joints_whose_targets_are_swapped(legs: Columns, told: Callable):
    legs["cmd_hip"], legs["cmd_ankle"] = legs["cmd_ankle"], legs["cmd_hip"]
    (found,) = told(legs)
    assert found.check == "target" and "(hip that of ankle, ankle that of hip)" in found.told


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("cmd_knee", lambda v: v * 180 / np.pi, "the target is in deg, the other in rad"),
        ("pos_knee", lambda v: v * 180 / np.pi, "the position is in deg, the other in rad"),
        ("cmd_knee", lambda v: -v, "moves against the target"),
        ("pos_knee", lambda v: v + 0.5, "one of the two has a wrong zero"),
        ("pos_knee", lambda v: 0.0 * v + 2.0, "stays at least 1."),
    ],
)
def test_what_is_wrong_between_a_joint_and_its_target(
    legs: Columns, told: Callable, name: str, change: Callable, says: str
):
    legs[name] = change(legs[name])
    if name == "pos_knee":
        legs["vel_knee"] = np.gradient(legs["pos_knee"], TIME)
    (found,) = told(legs)
    assert found.check == "target" and found.where == "log.csv, knee" and says in found.told


def test_the_step_of_a_sensor():
    rng = np.random.default_rng(0)
    coarse = 0.077 * np.round(rng.standard_normal(500) / 0.077)
    assert grain(coarse) == pytest.approx(0.077)
    assert grain(np.where(np.arange(500) % 2, 1.0, -1.0) + 1e-4 * rng.standard_normal(500)) < 1e-3
    assert grain(np.ones(10)) == 0.0

"""Timed commands out of a recording: what was told, for how long, and what the pose did meanwhile."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import LogError, RobotError
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.timed.commands import Commands, chained, drawn
from dynreg.timed.kinematic import kinematic
from dynreg.timed.told import told
from dynreg.timed.unicycle import PIONEER, unicycle
from dynreg.timed.wheels import POSE, Wheels


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


def recording(robot: Robot, *episodes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Recording:
    """Of times (T,), wheel speeds on the ground (T, 2) and poses (T, 3)."""
    wheels = [f"{w}_wheel/velocity_command" for w in ("left", "right")]
    channels = [Channel(n, u) for n, u in zip(POSE, ("m", "m", "rad"), strict=True)]
    channels += [Channel(n, "rad/s") for n in wheels]
    radius = robot.file.base.wheel_radius
    rows = [np.concatenate([pose, speed / radius], axis=1) for _, speed, pose in episodes]
    return Recording(
        tuple(channels),
        tuple(Episode(f"e{i}", e[0], r) for i, (e, r) in enumerate(zip(episodes, rows, strict=True))),
    )


def driven(robot: Robot, seed: int, many: int = 12) -> tuple:
    """Commands, what they move, and the log of them with a row where each begins and one at the end."""
    commands = drawn(many, stream(seed, "driven"))
    moved = kinematic(commands, robot.file.base.track)
    pose = chained(moved, np.array([0.3, -0.2, 2.5]))
    time = 4.0 + np.concatenate([[0.0], np.cumsum(commands.seconds)])
    speed = np.stack([commands.left, commands.right], axis=1)
    return commands, moved, (time, np.concatenate([speed, speed[-1:]]), pose)


def test_commands_and_displacements_come_back(robot: Robot) -> None:
    both = [driven(robot, seed) for seed in (1, 2)]
    found = told(robot, recording(robot, *(log for *_, log in both)))
    assert np.allclose(found.commands.table, np.concatenate([c.table for c, *_ in both]))
    assert np.allclose(found.moved, np.concatenate([m for _, m, _ in both]))
    assert found.episode.tolist() == [0] * 12 + [1] * 12


def test_rows_with_the_same_speeds_are_one_command_up_to_a_length(robot: Robot) -> None:
    time = np.arange(11) / 10
    speed = np.repeat([[0.1, 0.1], [0.1, 0.2]], [6, 5], axis=0)
    pose = np.stack([np.linspace(0, 0.1, 11), np.zeros(11), np.zeros(11)], axis=1)
    found = told(robot, recording(robot, (time, speed, pose)))
    assert found.commands.seconds == pytest.approx([0.6, 0.4])
    assert found.commands.right == pytest.approx([0.1, 0.2]) and found.commands.right_before == pytest.approx(
        [0, 0.1]
    )
    assert found.moved[:, 1] == pytest.approx([0.06, 0.04])
    short = told(robot, recording(robot, (time, speed, pose)), longest=0.3)
    assert short.commands.seconds == pytest.approx([0.3, 0.3, 0.3, 0.1])
    assert short.commands.right_before == pytest.approx([0.0, 0.1, 0.1, 0.2])


def test_commands_without_a_pose_are_left_out(robot: Robot) -> None:
    commands, moved, (time, speed, pose) = driven(robot, 6)
    pose[4] = np.nan
    found = told(robot, recording(robot, (time, speed, pose)))
    stay = np.array([i for i in range(12) if i not in (3, 4)])
    assert np.allclose(found.moved, moved[stay]) and np.allclose(found.commands.table, commands.table[stay])
    with pytest.raises(LogError, match="no command has a pose"):
        told(robot, recording(robot, (time, speed, np.full_like(pose, np.nan))))


def test_other_robots_and_logs_without_a_pose_are_refused(robot: Robot) -> None:
    log = recording(robot, driven(robot, 1)[2])
    with pytest.raises(RobotError, match="'servo_pendulum' has no wheels"):
        told(load_robot("servo_pendulum"), log)
    blind = Recording(log.channels[1:], tuple(Episode(e.name, e.time, e.values[:, 1:]) for e in log.episodes))
    with pytest.raises(LogError, match="no channel 'base/x'"):
        told(robot, blind)


def test_the_dynamic_model_of_commands_is_the_engine(robot: Robot) -> None:
    """Held commands from standstill, with couplings that can be seen: the same numbers from both."""
    names = ("speed_lag", "yaw_lag", "centrifugal", "speed_drag", "coupling", "yaw_drag")
    parameters = PIONEER * [1.0, 1.0, 10.0, 1.0, 10.0, 1.0]
    base = robot.file.base.model_copy(update=dict(zip(names, parameters, strict=True)))
    other = replace(robot, file=robot.file.model_copy(update={"base": base}))
    speeds = stream(1, "held").uniform(-10.0, 10.0, (6, 2))
    values = robot.space.from_dict(
        {n: v for n, v in zip(names, parameters, strict=True) if n in robot.space.names}
    )
    run = Run(np.repeat(speeds[:, None], 50, axis=1), period=0.02)
    state = rollout(other, values[None], run, engine="unicycle").states[0, :, -1]
    still = np.zeros(6)
    commands = Commands(*(base.wheel_radius * speeds).T, np.ones(6), still, still)
    moved = unicycle(commands, parameters, base.track)
    assert moved == pytest.approx(np.stack([-state[:, 5], state[:, 4], state[:, 6]], axis=1), abs=1e-12)


def test_a_yaw_within_one_turn_makes_the_whole_turns_of_its_commands(robot: Robot) -> None:
    commands, moved, (time, speed, pose) = driven(robot, 1, 30)
    assert np.abs(moved[:, 2]).max() > np.pi  # more than half a turn at once
    for low in (-np.pi, 0.0):
        wrapped = pose.copy()
        wrapped[:, 2] = low + np.mod(pose[:, 2] - low, 2 * np.pi)
        assert np.allclose(told(robot, recording(robot, (time, speed, wrapped))).moved, moved)


def turned(robot: Robot, told_rate: float, rate: float, period: float, seconds: float = 2.0) -> Recording:
    """A base that is told a yaw rate and turns at another [rad/s], its yaw logged from -pi to pi."""
    time = np.arange(0.0, seconds + 1e-9, period)
    wheel = 0.5 * robot.file.base.track * told_rate
    speed = np.tile([-wheel, wheel], (len(time), 1))
    speed[len(time) // 2 :] *= 0.999  # a second command
    yaw = np.mod(rate * time + np.pi, 2 * np.pi) - np.pi
    return recording(robot, (time, speed, np.stack([0 * time, 0 * time, yaw], axis=1)))


def test_rows_in_between_tell_whole_turns_whatever_was_told(robot: Robot) -> None:
    """A base that is blocked, or turns twice as quickly: what was told is a turn off."""
    for rate in (-0.5, 0.5, 10.0):
        found = told(robot, turned(robot, 5.0, rate, 0.05))
        assert found.moved[-1, 2] == pytest.approx(rate)
    back = told(
        robot, turned(robot, 2.4, -4.4, 0.5)
    )  # 1.2 rad told between rows, 2.2 rad turned the other way
    assert back.moved[-1, 2] == pytest.approx(-4.4)


def test_over_gaps_whole_turns_are_those_that_were_told(robot: Robot) -> None:
    assert told(robot, turned(robot, 5.0, 4.8, 1.0)).moved[:, 2] == pytest.approx([4.8, 4.8])


def test_an_episode_that_begins_on_the_way_loses_its_first_command(robot: Robot) -> None:
    """Held wheels from standstill, by the unicycle; then the same log from later on, and from a change of command."""
    base, period = robot.file.base, 0.05
    time = period * np.arange(41)
    speed = np.repeat([[0.15, 0.2], [0.1, 0.05]], [20, 21], axis=0)
    run = Run(speed[None, :-1] / base.wheel_radius, period=period)
    states = rollout(robot, robot.space.nominal[None], run, engine="unicycle").states[0, 0]
    pose = states[:, [robot.channels.index(name) for name in POSE]]
    whole = told(robot, recording(robot, (time, speed, pose)))
    assert len(whole.commands) == 2 and whole.on_the_way == 0
    for first in (10, 20):
        cut = (time[first:], speed[first:], pose[first:])
        both = told(robot, recording(robot, (time, speed, pose), cut))
        assert both.on_the_way == 1 and both.left_out == 0
        assert both.episode.tolist() == [0, 0] + [1] * (first == 10)
    standing = (time, 0.0 * speed, np.tile(pose[:1], (41, 1)))
    pushed = (time, 0.0 * speed, pose)
    assert told(robot, recording(robot, standing)).on_the_way == 0
    assert told(robot, recording(robot, pushed, (time, speed, pose))).on_the_way == 1


def test_places_of_commands_are_told(robot: Robot) -> None:
    commands, moved, (time, speed, pose) = driven(robot, 6)
    pose[4] = np.nan
    found = told(robot, recording(robot, (time, speed, pose)))
    stay = np.array([i for i in range(12) if i not in (3, 4)])
    assert np.allclose(found.begin, time[stay]) and np.allclose(found.end, time[stay + 1])
    assert np.allclose(found.start, pose[stay])
    assert found.left_out == 2 and found.track == robot.file.base.track


def test_logs_without_commands_are_refused(robot: Robot) -> None:
    log = recording(robot, driven(robot, 1)[2])
    mute = Recording(
        log.channels[:-1], tuple(Episode(e.name, e.time, e.values[:, :-1]) for e in log.episodes)
    )
    with pytest.raises(LogError, match="no channel 'right_wheel/velocity_command'"):
        told(robot, mute)


@pytest.mark.parametrize("radius", [0.03, None])
def test_a_matrix_makes_the_speeds_of_wheels(radius: float | None) -> None:
    wheels = Wheels(np.array([2, 0]), radius, 0.4)
    values = np.array([[0.3, 9.0, -1.0], [2.0, 9.0, 0.5]])
    assert wheels.speeds(values) == pytest.approx(values[:, [2, 0]] @ wheels.matrix.T)

"""Commands as they are played: each episode ends at rest, and a log of it holds every command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_robot import changed

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.excite import choose
from dynreg.excite.candidates import both, pool
from dynreg.excite.limits import Limits
from dynreg.excite.playing import PAUSE, closed, played
from dynreg.replay.cut import windows
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import reset_pose, targets
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.verbs.cautions import largest_steps

STEPS = 50


def some(robot: Robot) -> Run:
    """Three candidates."""
    return pool(robot, Limits.of(robot), (), STEPS, 0).take(np.array([2, 10, 20])).run


@pytest.mark.parametrize("name", ["emps", "simple_pendulum", "diffdrive", "create"])
def test_torques_and_speeds_end_at_zero(name: str) -> None:
    robot = load_robot(name)
    run = some(robot)
    assert (run.actions[:, -1] != 0.0).any(), "the commands themselves end anywhere"
    recording = played(robot, run, ("a", "b", "c"), {})
    for episode, actions in zip(recording.episodes, run.actions, strict=True):
        assert (episode.values[:-1] == actions).all() and (episode.values[-1] == 0.0).all()
        assert np.diff(episode.time) == pytest.approx(run.period)
    begins, ends = ([e.time[at] for e in recording.episodes] for at in (0, -1))
    assert np.subtract(begins[1:], ends[:-1]) == pytest.approx(PAUSE)


def test_targets_are_held(tmp_path: Path) -> None:
    robot = load_robot("so101")
    run = some(robot)
    assert (closed(robot, run.actions)[:, -1] == run.actions[:, -1]).all()
    mixed = changed(
        tmp_path / "arm",
        "two_joint_arm",
        {
            'joint = "elbow"\ntype = "position"\ngain = 20.0\nrate_gain = 0.5': 'joint = "elbow"\ntype = "torque"'
        }
        | {"port.drive.gain[elbow] =": "port.drive.gain[elbow] *="},
    )
    actions = some(mixed).actions
    last = closed(mixed, actions)[:, -1]
    assert (last[:, 0] == actions[:, -1, 0]).all() and (last[:, 1] == 0.0).all()


@pytest.mark.parametrize("name", ["servo_pendulum", "so101", "leg", "six_joint_arm"])
def test_no_target_jumps_from_an_episode_to_the_next(name: str) -> None:
    """On one clock, every candidate and the usual episodes in turn, through the pauses that hold the last row."""
    robot = load_robot(name)
    limits, pose, held = Limits.of(robot), reset_pose(robot), targets(robot)
    usual = choose._usual(robot, limits, 100, 4, 0)
    every = both(pool(robot, limits, (), 100, 0), usual)
    recording = played(robot, every.run, every.names, {})
    rows = np.concatenate([pose[None], *(e.values[:, : len(pose)] for e in recording.episodes)])
    steps = np.abs(np.diff(rows, axis=0))[:, held]
    assert (steps <= limits.rate[held] / robot.rate + 1e-9).all()
    assert all((e.values[-1, : len(pose)] == pose)[held].all() for e in recording.episodes)
    assert largest_steps(robot, every.run)[held] == pytest.approx(steps.max(axis=0))


def test_a_target_without_a_rate_limit_goes_back_over_a_fifth_of_the_commands() -> None:
    free = Limits(np.array([-9.0]), np.array([9.0]), np.array([np.inf]))
    back = free.returned(np.full((20, 1), 4.0), np.zeros(1), np.array([True]), 0.1)[:, 0]
    assert (back[:16] == 4.0).all() and back[15:] == pytest.approx([4.0, 3.0, 2.0, 1.0, 0.0])
    torque = free.returned(np.full((20, 1), 4.0), np.zeros(1), np.array([False]), 0.1)
    assert (torque == 4.0).all()


def test_a_drive_that_was_switched_off_stays_off() -> None:
    robot = load_robot("servo_pendulum")
    made = pool(robot, Limits.of(robot), (), STEPS, 0)
    (number, *_) = [i for i, name in enumerate(made.names) if name.startswith("drop")]
    recording = played(robot, made.take(np.array([number])).run, ("a",), {})
    assert recording.names == ("arm/target", "arm/enabled")
    assert (recording.episodes[0].values[-1] == recording.episodes[0].values[-2]).all()


def test_a_log_of_them_is_cut_into_windows_of_all_their_commands() -> None:
    """The last row of a log tells a state alone: without the closing one a command would be lost to a diagnosis."""
    robot = load_robot("simple_pendulum")
    run = some(robot)
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    commands = played(robot, run, ("a", "b", "c"), {})
    tables = (*robot.file.channels, *robot.file.actions)
    episodes = [
        Episode(e.name, e.time, np.concatenate([seen, e.values], axis=1))
        for e, seen in zip(commands.episodes, states, strict=True)
    ]
    horizon = robot.file.replay.model_copy(update={"horizon": STEPS / robot.rate})
    robot = replace(robot, file=robot.file.model_copy(update={"replay": horizon}))
    cut = windows(robot, Recording(tuple(Channel(t.name, t.unit) for t in tables), tuple(episodes), True))
    np.testing.assert_array_equal(cut.run.actions, run.actions)

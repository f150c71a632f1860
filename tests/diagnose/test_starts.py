"""What the noise of a start does to a rollout is noise: the error that it leaves is no unknown cause."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.verdict import Evidence
from dynreg.evidence.lockstep import run
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

ASKED = DiagnosisOptions(hold_out="e3", threads=1)


def logged(robot: Robot, commands: np.ndarray) -> Recording:
    """What the nominal robot logs of commands (E, T, A), with the noise of its sensors."""
    states = rollout(
        robot, robot.space.nominal[None], Run(commands, period=1 / robot.rate), threads=1
    ).states[0]
    noisy = states + robot.sensor_noise * stream(3, "noise").standard_normal(states.shape)
    held = np.concatenate([commands, commands[:, -1:]], axis=1)
    rows = np.concatenate([noisy, held], axis=2)
    time = np.arange(rows.shape[1]) / robot.rate
    tables = (*robot.file.channels, *robot.file.actions)
    channels = tuple(Channel(t.name, t.unit) for t in tables)
    return Recording(
        channels, tuple(Episode(f"e{i}", time, one) for i, one in enumerate(rows)), measured=False
    )


def precise(name: str, horizon: float) -> Robot:
    """A packaged robot whose positions are known better than its velocities tell where it will be."""
    robot = load_robot(name)
    told = {"position": {"noise": 0.001, "quantum": 0.0}, "velocity": {"noise": 0.05, "quantum": 0.0}}
    channels = [c.model_copy(update=told[c.name.split("/")[1]]) for c in robot.file.channels]
    replay = robot.file.replay.model_copy(update={"horizon": horizon})
    return replace(robot, file=robot.file.model_copy(update={"channels": channels, "replay": replay}))


def swung(robot: Robot, size: float) -> np.ndarray:
    """(4, T, 1) sums of three sines, each episode of others."""
    t, rng = np.arange(round(6 * robot.rate)) / robot.rate, stream(3, "commands")
    waves = np.sin(2 * np.pi * (rng.uniform(0.2, 1.2, (4, 3, 1)) * t + rng.uniform(size=(4, 3, 1))))
    return size * waves.sum(axis=1)[..., None] / 3


def test_a_servo_makes_good_what_the_noise_of_its_start_did():
    robot = precise("servo_pendulum", horizon=1.0)
    log = logged(robot, swung(robot, 0.5))
    _, data = pose(robot, log, ASKED)
    assert np.array_equal(data.noise, robot.sensor_noise)


def test_what_the_noise_of_a_start_leaves_is_no_unknown_cause():
    robot = precise("simple_pendulum", horizon=1.0)
    position = robot.channels.index("pivot/position")
    log = logged(robot, swung(robot, 1.5))
    model, data = pose(robot, log, ASKED)
    assert 5 < data.noise[position] / robot.sensor_noise[position] < 100
    model = replace(model, accuracy=replace(model.accuracy, finer=1.0))  # as the log was made
    found = run(Evidence.of(State(model, data.sample(data.fit), model.start, model.start), log))
    assert found.noise.basis == "stated_noise" and found.explained, "the simulator is the robot"
    assert found.noise.left > 4 * robot.sensor_noise[position]


def test_neither_what_is_held_out_nor_what_was_not_measured_tells_the_noise():
    robot = precise("simple_pendulum", horizon=1.0)
    log = logged(robot, swung(robot, 1.5))
    told = pose(robot, log, ASKED)[1].noise
    *kept, held = log.episodes
    other = replace(held, values=np.flip(held.values, axis=0))
    assert np.array_equal(pose(robot, replace(log, episodes=(*kept, other)), ASKED)[1].noise, told)
    robot = precise("simple_pendulum", horizon=6.0)
    cut = [slice(50 * k, 50 * k + 30) for k in range(4)]  # 0.3 s: the error of a start still grows
    short = [
        replace(e, name=f"{e.name}_{k}", time=e.time[:30], values=e.values[rows])
        for e in kept
        for k, rows in enumerate(cut)
    ]
    alone = pose(robot, replace(log, episodes=(*short, held)), ASKED)[1].noise
    beside = pose(robot, replace(log, episodes=(*short, kept[0], held)), ASKED)[1].noise
    assert beside == pytest.approx(alone, rel=0.1), (
        "the commands of short ones go on to the end of the longest"
    )

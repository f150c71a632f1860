"""Servo benches that tests know and queries do not: simulated apart from the population, measured with noise.

A secret servo runs at a quarter of the robot's time step, on commands that no population ran, and is read by a
noisy and quantised encoder, as the robot folder says of the real one.
"""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.distance.population import Training
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot

TRAINING = Training(epochs=1, base_configurations=16, base_epochs=3)  # of the population that is asked
ENTRIES = 24


def values_of(seed: int, **planted: float) -> np.ndarray:
    """(P,) a configuration well inside the ranges, with some parameters given."""
    space = load_robot("servo_pendulum").space
    drawn = space.from_unit(stream(seed, "secret servo").uniform(0.1, 0.9, len(space)))
    return space.from_dict(space.as_dict(drawn) | planted)


def record(
    values: np.ndarray,
    seed: int,
    *,
    episodes: int = 10,
    steps: int = 120,
    alter: Callable[[mujoco.MjModel], None] | None = None,
) -> Recording:
    """What a servo with these parameters (P,) did; `alter` changes its model beyond what parameters can say."""
    robot = finer(load_robot("servo_pendulum"))
    if alter:
        alter(robot.model)
    run = excitation(robot, seed=seed, name="secret", episodes=episodes, steps=steps)
    states = rollout(robot, values[None], run).states[0]
    rng = stream(seed, "secret noise")
    for i, channel in enumerate(robot.file.channels):
        states[..., i] += channel.noise * rng.standard_normal(states.shape[:2])
        states[..., i] = channel.quantum * np.round(states[..., i] / channel.quantum)
    # the command of the last row was never followed by a state: it is held
    held = lambda a: np.concatenate([a, a[:, -1:]], axis=1)  # noqa: E731
    table = np.concatenate([states, held(run.actions), held(run.inputs)], axis=-1)
    units = [(c.name, c.unit) for c in (*robot.file.channels, *robot.file.actions, *robot.file.inputs)]
    channels = tuple(Channel(*unit) for unit in units) + (Channel("arm/enabled", "1"),)
    time = np.arange(steps + 1) / robot.rate
    return Recording(
        channels,
        tuple(Episode(f"run{e}", time, table[e], {"kp": run.settings[e, 0]}) for e in range(episodes)),
    )


def finer(robot: Robot, times: int = 4) -> Robot:
    """The robot with a smaller time step and a model of its own."""
    settings = robot.file.robot.model_copy(update={"timestep": robot.file.robot.timestep / times})
    return replace(robot, file=robot.file.model_copy(update={"robot": settings}))

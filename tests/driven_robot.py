"""Logs of simulated wheeled robots: drawn commands, held for a while, and what the robot's engine makes of them."""

from collections.abc import Mapping

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

PERIOD = 0.02  # s


def config(robot: Robot, values: Mapping[str, float] | None = None, effects: dict | None = None) -> SimConfig:
    """The robot's nominal simulator, but for some values and effects."""
    nominal = robot.space.as_dict(robot.space.nominal)
    return SimConfig(robot.hash, robot.name, nominal | dict(values or {}), effects or {})


def commands(robot: Robot, many: int, seed: int, seconds: tuple[float, float] = (0.1, 0.5)) -> np.ndarray:
    """(T, A) drawn within 0.7 of the actions' ranges, each held for a time."""
    rng = stream(seed, "driven robot")
    steps = np.maximum(1, (rng.uniform(*seconds, many) / PERIOD).round().astype(int))
    most = np.array([0.7 * a.high for a in robot.file.actions])
    return np.repeat(rng.uniform(-most, most, (many, len(most))), steps, axis=0)


def logged(
    robot: Robot,
    truth: SimConfig,
    told: list[np.ndarray],
    *,
    engine: str | None = None,
    noise: float = 0.0,
    seed: int = 0,
) -> Recording:
    """A recording of episodes with commands (T, A): as many rows as commands and one more, which holds the last.

    noise : times the channels' own.
    """
    sigma = noise * np.array([c.noise for c in robot.file.channels])
    values = robot.space.from_dict(dict(truth.values))[None]
    episodes = []
    for number, actions in enumerate(told):
        run = Run(actions[None], period=PERIOD)
        states = rollout(robot, values, run, engine=engine, terms=terms_of(truth, robot)).states[0, 0]
        states = states + sigma * stream(seed, "noise", number).standard_normal(states.shape)
        rows = np.concatenate([states, np.concatenate([actions, actions[-1:]])], axis=1)
        episodes.append(Episode(f"run_{number}", PERIOD * np.arange(len(rows)), rows))
    tables = (*robot.file.channels, *robot.file.actions)
    return Recording(tuple(Channel(t.name, t.unit) for t in tables), tuple(episodes), measured=False)

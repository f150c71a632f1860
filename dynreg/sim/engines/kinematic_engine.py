"""Planar bases in plain numpy: speed and yaw rate follow their commands, the pose is their integral.

lag times rate of speed = command - drag speed, the same for the yaw rate; rate of x = speed cos(yaw), rate of
y = speed sin(yaw). The velocities are exact for commands that are held; within a time step the base drives an arc at
their mean.
"""

import numpy as np

from dynreg.sim.effects import Terms
from dynreg.sim.engines.planar_base import Law, planar_rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated

LEAST = 1e-12  # s: a lag without any


def simulate(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Simulated:
    """N simulations, each of parameters (N, P) and an episode of `run` of its own; `threads` changes nothing here.

    Couplings of speed and yaw rate are the unicycle engine's. Raises as `planar_rollout`.
    """
    return planar_rollout(robot, values, run, terms, _Arcs())


class _Arcs:
    """Time steps of any length."""

    def longest(self, law: Law, h: np.ndarray) -> np.ndarray:
        return h

    def advance(
        self, velocity: np.ndarray, target: np.ndarray, law: Law, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        goal = target / law.drag
        ratio = h / np.maximum(law.lag / law.drag, LEAST)
        keep, excess = np.exp(-ratio), velocity - goal
        mean = goal + excess * ((1.0 - keep) / ratio)
        return goal + excess * keep, mean, mean

    def displace(self, yaw: np.ndarray, stages: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, ...]:
        turned = stages[1] * h
        chord = stages[0] * h * np.sinc(turned / (2.0 * np.pi))  # sinc(x) = sin(pi x) / (pi x)
        heading = yaw + 0.5 * turned
        return chord * np.cos(heading), chord * np.sin(heading), turned

"""Planar bases with inertia in plain numpy: the unicycle with six parameters, by Runge and Kutta's rule.

a1 v' = v_command - a4 v + a3 w^2 and a2 w' = w_command - a6 w - a5 v w for speed v and yaw rate w (the model of De La
Cruz and Carelli, its reference point on the axle): a1, a2 the lags, a4, a6 the drags, a3 `centrifugal`, a5 `coupling`.
Without a3 and a5 it is the kinematic engine's, but for the error of the time step.
"""

import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms
from dynreg.sim.engines.planar_base import Law, planar_rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated

SHORTEST = 1e-3  # s: a shorter lag is the kinematic engine's


def simulate(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Simulated:
    """N simulations, each of parameters (N, P) and an episode of `run` of its own; `threads` changes nothing here.

    Raises as `planar_rollout`, and SimulationError where speed or yaw rate follow (nearly) without a lag.
    """
    return planar_rollout(robot, values, run, terms, _RungeKutta())


class _RungeKutta:
    """The rule of fourth order, for velocities and pose together: the pose acts on nothing."""

    def longest(self, law: Law, h: np.ndarray) -> np.ndarray:
        """Within them no velocity moves by more than its distance to the command."""
        shortest = law.lag.min(axis=0)
        if (shortest < SHORTEST).any():
            raise SimulationError(
                f"speed or yaw rate follow their commands with a lag of {shortest.min():g} s",
                expected=f"at least {SHORTEST:g} s in the unicycle engine",
                do="give [base] or the drives a longer lag, or use the kinematic engine",
            )
        return np.minimum(h, (law.lag / law.drag).min(axis=0))

    def advance(
        self, velocity: np.ndarray, target: np.ndarray, law: Law, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        stages, rates = np.empty((4, *velocity.shape)), np.empty((4, *velocity.shape))
        stages[0], rates[0] = velocity, _rate(velocity, target, law)
        for number, share in ((1, 0.5), (2, 0.5), (3, 1.0)):
            stages[number] = velocity + share * h * rates[number - 1]
            rates[number] = _rate(stages[number], target, law)
        return velocity + h * _mean(rates), _mean(stages), stages

    def displace(self, yaw: np.ndarray, stages: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, ...]:
        heading = np.empty((4, len(yaw)))
        heading[0] = yaw
        for number, share in ((1, 0.5), (2, 0.5), (3, 1.0)):
            heading[number] = yaw + share * h * stages[number - 1, 1]
        speed = stages[:, 0]
        return tuple(
            h * _mean(rate) for rate in (speed * np.cos(heading), speed * np.sin(heading), stages[:, 1])
        )


def _rate(velocity: np.ndarray, target: np.ndarray, law: Law) -> np.ndarray:
    """(2, n) rates of speed and yaw rate."""
    out = target - law.drag * velocity
    out[0] += law.centrifugal * velocity[1] ** 2
    out[1] -= law.coupling * velocity[0] * velocity[1]
    return out / law.lag


def _mean(stages: np.ndarray) -> np.ndarray:
    """Of values (4, ...) at the stages, by the rule's weights."""
    return (stages[0] + 2.0 * stages[1] + 2.0 * stages[2] + stages[3]) / 6.0

"""Twins of a simulator: robots that are it, as far as their time step, drives and sensors let them.

A robot of the family differs from the simulator that is right about it by no more than that: its time goes on in finer
steps, its drives are disturbed, its start states were measured with noise, and so is what it did then. What errors this
makes, in the very windows of a recording, is known only from simulated ones.
"""

from dataclasses import replace

import numpy as np

from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.truth import Hidden, measured_states
from dynreg.replay.windows import Windows, standing
from dynreg.rng import stream, stream_seed
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, motor_noise

# Times finer than the model's time step. Of what a first-order step gets wrong this leaves a quarter; ten times and
# Runge-Kutta, as hidden robots of trials have, made a query of the leg twice as long.
FINER = 4


def twins(robot: Robot, windows: Windows, values: np.ndarray, seed: int) -> Search[np.ndarray]:
    """(n, W, T+1, S) what the sensors of twins of simulators (n, P) say in the windows; NaN where nothing was measured.

    Each has noise of its own, drawn from `seed` and its number. They start where the recording does, up to the noise of
    the start states, and have the motor noise of their parameters.
    """
    rows = standing(robot, windows.run.actions, windows.measured, windows.run.rolling)
    truth = robot.stepped(FINER)
    starts = robot.sensor_noise / np.sqrt(rows)[:, None]

    def one(number: int) -> Search[np.ndarray]:
        own = stream_seed(seed, "twin", number) % 2**62
        error = starts * stream(own, "starts").standard_normal(starts.shape)
        run = replace(
            windows.run, initial=windows.run.initial + error, noise=_motor_noise(robot, windows.run, own)
        )
        return measured_states(robot, Hidden((), (), values[number], own), run, truth=truth)

    states = np.array((yield from together(one(number) for number in range(len(values)))))
    return np.where(np.isfinite(windows.measured), states, np.nan)


def _motor_noise(robot: Robot, run: Run, seed: int) -> np.ndarray:
    """(W, T, A) draws for the motor noise of one twin."""
    return motor_noise(np.array([seed]), run.episodes, run.steps, len(robot.actions))[0]

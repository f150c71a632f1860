"""Entries: what the sensors of simulators with one effect or none would say under the commands of a log."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.rng import stream
from dynreg.sim.real import disturbance, disturbed, sensed
from dynreg.sim.robot import Robot

TOGETHER = 64  # entries of one batch, which share the errors of their starts and their disturbance


def logs(model: Model, points: Sequence[Point], sample: Sample, robot: Robot, seed: int) -> Search[np.ndarray]:
    """(n, W, T+1, S) states of the points in the windows of a sample as sensors say them.

    They start within the noise of the measured starts, and have the torque disturbance and sensor noise of hidden
    robots. robot : with the sensor noise of its log.
    """
    rng = stream(seed, "noise of entries")
    run = sample.data.windows.run.take(sample.chosen)
    if run.initial is not None:
        off = robot.sensor_noise * rng.standard_normal(run.initial.shape)
        run = replace(run, initial=run.initial + off)
    noise = disturbance(model.robot)
    unsteady = [
        Point(p.hypothesis.with_term(noise), p.nominal, np.append(p.effect, 1.0))  # of its one size
        for p in points
    ]
    states = yield from model.states(unsteady, disturbed(model.robot, run, rng))
    return sensed(robot, states, rng)

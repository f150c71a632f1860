"""The strongest rival of a truth under given commands: the other hypothesis, fitted to what a logger would write."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.fit import fit
from dynreg.diagnose.problem import Point, Problem
from dynreg.excite.separate import Pair
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.real import LEAST_NOISE
from dynreg.sim.run import Run

SIZES = (0.3, 1.0, 2.0)  # medium sizes from which a fit may start
ROUGHLY, WHOLLY = 2, 5  # iterations for all starts, and for the best
KEPT = 2


def strongest(
    pair: Pair, run: Run, truth: tuple[int, np.ndarray], starts: list[np.ndarray]
) -> tuple[float, np.ndarray]:
    """(nats, coordinates (D,)) of the other hypothesis at its best, where `truth` (hypothesis, coordinates) holds.

    nats : by how much the truth, fitted too, is the more likely; not below zero. starts : coordinates (D,) to fit from.
    """
    which, z = truth
    free = len(pair.coordinates)
    problem, every = _problem(pair, run, truth), np.arange(run.episodes)
    here, there = (
        [Point(pair.hypotheses[number], at[:free], at[free:]) for at in some]
        for number, some in ((which, [z]), (1 - which, starts))
    )
    effective = problem.effective(problem.residuals(here, every)[0])
    if len(there) > KEPT:
        points, cost = fit(problem, there, every, effective, iterations=ROUGHLY)
        there = [points[i] for i in np.argsort(cost, kind="stable")[:KEPT]]
    points, cost = fit(problem, [*here, *there], every, effective, iterations=WHOLLY)
    best = 1 + int(cost[1:].argmin())
    return max(float(cost[best] - cost[0]), 0.0), points[best].z


def first_starts(pair: Pair, number: int) -> list[np.ndarray]:
    """Coordinates (D,) of hypothesis `number` at the nameplate: sizes, with either sign of its first parameter."""
    limits = pair.bounds(number)
    return [np.clip(size * z, *limits.T) for z in pair.medium(number) for size in SIZES]


def _problem(pair: Pair, run: Run, truth: tuple[int, np.ndarray]) -> Problem:
    """What the truth, disturbed, is measured as in `run`, ready to be fitted."""
    robot = pair.robot
    states = pair.simulate([truth], run, disturbed=True).states[0]
    stated = robot.sensor_noise
    draw = stream(pair.seed, "excite", robot.name, "measured").standard_normal(states.shape)
    measured = states + np.where(stated > 0, stated, LEAST_NOISE) * draw
    weight = np.array([c.weight for c in robot.file.channels])
    spread = np.maximum(measured.std(axis=(0, 1)), LEAST_NOISE)
    count = run.episodes
    windows = Windows(
        replace(run, initial=measured[:, 0]),
        measured,
        spread,
        weight / weight.sum(),
        np.arange(count),
        np.tile([0, run.steps + 1], (count, 1)),
        run.period,
    )
    # whole rollouts, as `separate.Judge` weighs them
    return Problem(robot, windows, pair.coordinates, pair.engine, pair.threads, whole=True)

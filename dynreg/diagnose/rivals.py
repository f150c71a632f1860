"""The strongest rival of a truth under given commands: the other hypothesis, fitted to what a logger would write."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.fit import fit
from dynreg.diagnose.problem import Point, Problem, effective_samples
from dynreg.diagnose.separate import Pair
from dynreg.diagnose.truth import LEAST_NOISE
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.run import Run

SIZES = (0.3, 1.0, 2.0)  # medium sizes that a fit starts from
ROUGHLY, WHOLLY = 2, 5  # iterations for all starts, and for the best
KEPT = 2


def strongest(pair: Pair, run: Run, truth: tuple[int, np.ndarray]) -> tuple[float, np.ndarray]:
    """(nats, coordinates (D,)) of the other hypothesis at its best, where `truth` (hypothesis, coordinates) holds.

    nats : by how much the truth, fitted too, is the more likely; not below zero.
    """
    which, z = truth
    problem = _problem(pair, run, truth)
    every = np.arange(run.episodes)
    free = len(pair.coordinates)
    at_truth = Point(pair.hypotheses[which], z[:free], z[free:])
    effective = effective_samples(problem.residuals([at_truth], every)[0])
    points, cost = fit(problem, _starts(pair, 1 - which), every, effective, iterations=ROUGHLY)
    points = [points[i] for i in np.argsort(cost, kind="stable")[:KEPT]]
    points, cost = fit(problem, [at_truth, *points], every, effective, iterations=WHOLLY)
    best = 1 + int(cost[1:].argmin())
    return max(float(cost[best] - cost[0]), 0.0), points[best].z


def _problem(pair: Pair, run: Run, truth: tuple[int, np.ndarray]) -> Problem:
    """What the truth, disturbed, is measured as in `run`, ready to be fitted."""
    robot = pair.robot
    states = pair.simulate([truth], run, disturbed=True).states[0]
    stated = np.sqrt([c.noise**2 + c.quantum**2 / 12 for c in robot.file.channels])
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
    return Problem(robot, windows, pair.coordinates, threads=pair.threads)


def _starts(pair: Pair, number: int) -> list[Point]:
    """Points of hypothesis `number` at the nameplate: sizes, with either sign of its first parameter."""
    free, hypothesis = len(pair.coordinates), pair.hypotheses[number]
    limits = pair.bounds(number)[free:]
    out = []
    for z in pair.medium(number):
        for size in SIZES:
            effect = np.clip(size * z[free:], limits[:, 0], limits[:, 1])
            out.append(Point(hypothesis, np.zeros(free), effect))
    return out

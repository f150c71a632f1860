"""The strongest rival of a truth under given commands: the other hypothesis, fitted to what a logger would write."""

from dataclasses import replace

import numpy as np

from dynreg.evidence.accuracy import usual
from dynreg.evidence.data import Data
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.excite.separate import Pair
from dynreg.replay.parts import Parts
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.real import LEAST_NOISE
from dynreg.sim.run import Run

SIZES = (0.3, 1.0, 2.0)  # medium sizes from which a fit may start
ROUGHLY, WHOLLY = 2, 5  # iterations for all starts, and for the best
KEPT = 2


def strongest(
    pair: Pair, run: Run, truth: tuple[int, np.ndarray], starts: list[np.ndarray]
) -> Search[tuple[float, np.ndarray]]:
    """(nats, coordinates (D,)) of the other hypothesis at its best, where `truth` (hypothesis, coordinates) holds.

    nats : by how much the truth, fitted too, is the more likely; not below zero. starts : coordinates (D,) to fit from.
    """
    which, z = truth
    free = len(pair.coordinates)
    model = Model(pair.robot, pair.coordinates, pair.engine, accuracy=usual(pair.robot, pair.engine))
    sample = _measured(pair, run, truth).sample(np.arange(run.episodes))
    here, there = (
        [Point(pair.hypotheses[number], at[:free], at[free:]) for at in some]
        for number, some in ((which, [z]), (1 - which, starts))
    )
    sample = sample.reweighted((yield from model.residuals(here, sample))[0])
    if len(there) > KEPT:
        there = best_of(*(yield from fit(model, there, sample, iterations=ROUGHLY)), KEPT)
    points, cost = yield from fit(model, [*here, *there], sample, iterations=WHOLLY)
    best = 1 + int(cost[1:].argmin())
    return max(float(cost[best] - cost[0]), 0.0), points[best].z


def first_starts(pair: Pair, number: int) -> list[np.ndarray]:
    """Coordinates (D,) of hypothesis `number` at the nameplate: sizes, with either sign of its first parameter."""
    limits = pair.bounds(number)
    return [np.clip(size * z, *limits.T) for z in pair.medium(number) for size in SIZES]


def _measured(pair: Pair, run: Run, truth: tuple[int, np.ndarray]) -> Data:
    """What the truth, disturbed, is measured as in `run`: whole rollouts, as `separate.Judge` weighs them."""
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
    every, none = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    return Data.of(robot, windows, Parts(every, none, none))

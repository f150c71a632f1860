"""Entries: simulators with one effect or none under the commands of a log, what they do, and their features."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from dynreg.diagnose.ranking.draws import drawn
from dynreg.diagnose.ranking.features import Frame
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.rng import stream
from dynreg.sim.effects import Term
from dynreg.sim.real import disturbance, disturbed, sensed
from dynreg.sim.robot import Robot

# Entries of one batch, which share the errors of their starts and their disturbance. On the servo bench robots with
# draws of their own are ranked as well as held-out entries are.
TOGETHER = 64


@dataclass(frozen=True, eq=False)
class Entries:
    """Consecutive entries (n).

    values : (n, P) parameters in their units. carried : (n,) number of the term that each has, -1 for none; effects :
    (n, K) its values, and points : (n, P' + K) coordinates, 0 where there are fewer. states : (n, W, T+1, S) as sensors
    say them. features : (n, F).
    """

    values: np.ndarray
    carried: np.ndarray
    effects: np.ndarray
    points: np.ndarray
    states: np.ndarray
    features: np.ndarray


def entries(
    frame: Frame, terms: Sequence[Term], robot: Robot, numbers: Sequence[int], seed: int
) -> Search[Entries]:
    """The entries `numbers` of a population; each depends on its number, not on what is made beside it.

    frame : of a model without corrections: entries have its own time step. robot : with the sensor noise of its log.
    """
    use = frame.sample.data.use
    points, states, features = [], [], []
    for group, some in groupby(numbers, lambda i: i // TOGETHER):
        some = list(some)
        own = drawn(frame.model, terms, some, seed)
        said = yield from _said(frame, own, some, robot, seed, group)
        points += own
        states.append(said.astype(np.float32))
        # as they are stored
        features.append((yield from frame.features(said[..., 1:, use])).astype(np.float16))
    return Entries(
        *_told(frame.model, terms, points), states=np.concatenate(states), features=np.concatenate(features)
    )


def _said(
    frame: Frame, points: Sequence[Point], numbers: Sequence[int], robot: Robot, seed: int, group: int
) -> Search[np.ndarray]:
    """(n, W, T+1, S) states of entries; those that carry nothing have the noise of hidden robots.

    That is, they start within the noise of the measured starts, under a torque disturbance, and sensors say them.
    """
    model, sample = frame.model, frame.sample
    run = sample.data.windows.run.take(sample.chosen)
    given = len(model.start.hypothesis.terms)
    bare = np.array([len(p.hypothesis.terms) == given for p in points])
    out = np.empty((len(points), run.episodes, run.steps + 1, len(robot.channels)))
    if not bare.all():
        out[~bare] = yield from model.states([p for p, b in zip(points, bare, strict=True) if not b], run)
    if bare.any():
        rng, limits = stream(seed, "group", group), model.coordinates.drive_limits
        (noise,) = disturbance(model.robot, limits).terms
        if run.initial is not None:
            off = robot.sensor_noise * rng.standard_normal(run.initial.shape)
            run = replace(run, initial=run.initial + off)
        unsteady = [
            Point(p.hypothesis.with_term(noise), p.nominal, np.append(p.effect, 1.0))  # of its one size
            for p, b in zip(points, bare, strict=True)
            if b
        ]
        moved = yield from model.states(unsteady, disturbed(run, limits, rng))
        own = [n for n, b in zip(numbers, bare, strict=True) if b]
        out[bare] = [sensed(robot, s, stream(seed, "sensors", i)) for i, s in zip(own, moved, strict=True)]
    return out


def _told(
    model: Model, terms: Sequence[Term], points: Sequence[Point]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`values`, `carried`, `effects` and `points` of entries."""
    c, keys = model.coordinates, {term.key: number for number, term in enumerate(terms)}
    given, sizes = len(model.start.hypothesis.terms), len(model.start.effect)
    width = max(len(term.effect.parameters) for term in terms)
    carried, effects = np.full(len(points), -1), np.zeros((len(points), width))
    rows = np.zeros((len(points), len(c) + sizes + width))
    for number, point in enumerate(points):
        rows[number, : len(point.z)] = point.z
        if len(point.hypothesis.terms) > given:
            carried[number] = keys[point.hypothesis.terms[-1].key]
            own = c.effect_values(point.hypothesis, point.effect[None])[-1][0]
            effects[number, : len(own)] = own
    return c.values(rows[:, : len(c)]), carried, effects, rows

"""Polish: the last iterations of a fit by rollouts that are simulated finely, which are dear."""

from collections.abc import Sequence

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.fit import steps
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.slopes import slopes

GAINED = 3.0  # nats that an iteration must gain for another one, after the second; measured with `Contact`'s


def polish(
    model: Model, points: Sequence[Point], sample: Sample, *, iterations: int, hopeless: float = np.inf
) -> Search[tuple[list[Point], np.ndarray]]:
    """The points improved by rollouts with the finer time step, which alone says what time steps do to contacts.

    Derivatives, and which of the steps is best, come from the usual time step; that step and half of it are tried with
    the finer one. Independent samples are those of each point's own residual, anew after the second iteration.
    Returns the points and their residuals (n, W, T, C) with the finer one. A point, other than the first, stops when
    after an iteration it is more than `hopeless` [nats] behind the best.
    """
    points = list(points)
    residuals = yield from model.fine.residuals(points, sample)
    going = np.arange(len(points))
    for number in range(iterations):
        if number in (0, 2):
            own = [sample.reweighted(r) for r in residuals]
        now, left = [points[i] for i in going], [own[i] for i in going]
        moved = yield from _promising(model, now, residuals[going], left)
        made = yield from model.fine.residuals(moved, sample)
        gained = np.zeros(len(going))
        for row, i in enumerate(going):
            of = slice(2 * row, 2 * row + 2)
            three = np.concatenate([residuals[i : i + 1], made[of]])
            costs = objective([points[i], *moved[of]], three, own[i])
            best = int(costs.argmin())
            points[i], residuals[i] = [points[i], *moved[of]][best], three[best]
            gained[row] = costs[0] - costs[best]
        if number >= 2:
            going = going[gained > GAINED]
        cost = objective(points, residuals, own[0])
        going = going[(cost[going] <= cost.min() + hopeless) | (going == 0)]
        if not len(going):
            break
    return points, residuals


def _promising(
    model: Model, points: list[Point], residuals: np.ndarray, samples: list[Sample]
) -> Search[list[Point]]:
    """Of each point the best step by the usual time step, and half of it; `residuals` are of the finer one."""
    slope = yield from slopes(model, points, samples[0])
    tries = [
        steps(model, p, r, s, own) for p, r, s, own in zip(points, residuals, slope, samples, strict=True)
    ]
    made = yield from model.residuals([*points, *(t for own in tries for t in own)], samples[0])
    out, at = [], len(points)
    for row, own in enumerate(tries):
        likely = made[at : at + len(own)] - made[row] + residuals[row]
        far = own[int(objective(own, likely, samples[row]).argmin())]
        out += [far, points[row].moved(0.5 * (points[row].z + far.z))]
        at += len(own)
    return out

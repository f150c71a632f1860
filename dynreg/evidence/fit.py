"""Fit: regularised Gauss-Newton on rollouts, for all hypotheses and starts at once, derivatives by differences.

Minimises  sum over windows (n_eff / 2) log(mean squared residual)  +  the prior's penalty: the negative logarithm
of the posterior when the residual's size is unknown. Every iteration simulates all perturbed candidates of all
rows as one batch.
"""

from collections.abc import Sequence

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.likelihood import information, objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.evidence.slopes import near_another, slopes

# bench_constants, 16 of 21 named with 2645 nats for what was hidden: half and twice of DAMPINGS, PULLS and REACH name
# the same with 2754 and 2778, of SHARES with 2751 and 2690; FEWER of two with 2643, of all seven with 2776, 2 s later.
DAMPINGS = (1e-5, 1e-2, 1.0)  # relative to the curvature of each coordinate
PULLS = (30.0,)  # times the prior: steps along valleys that the data hardly sees, back to the nameplate
REACH = 2.0  # largest change of a coordinate in one iteration
SHARES = (2.0, 0.4, 0.15)  # of the boldest step, tried too: valleys are long, and bent
FEWER = (0, 2, 3, 5)  # of all these steps, those tried where derivatives are only roughly known
ITERATIONS = 4  # where a caller asks for no other number,
ENOUGH = 0.3  # nats that an iteration must gain for another one
# nats that an iteration with carried derivatives must gain: less is a foot that slips a moment earlier, as for `Feet`
CHAOS = 5.0
# of what the last step with fresh derivatives gained, below which they are measured anew (an AIBO: 1700, then 300, 100)
SLOWER = 0.25

Fitted = tuple[list[Point], np.ndarray]


def fit(
    model: Model,
    points: Sequence[Point],
    sample: Sample,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = ENOUGH,
    leading: np.ndarray | None = None,
    hopeless: float = np.inf,
    known: dict[Point, np.ndarray] | None = None,
) -> Search[Fitted]:
    """Improve every point on a sample.

    leading : (L, W, T, C) derivatives of the first L coordinates where they are known well enough: only the others
    are measured, and fewer steps are tried.
    Returns the points and their objective (n,), lower is better [nats]. A row stops when an iteration (where
    derivatives are to one side: one to either) gains less than `tolerance`, or when after two of them it is more than
    `hopeless` [nats] behind the best.

    Of a model with many parameters (`Model.dear`) derivatives are measured once and carried on from step to step. They
    are measured anew where a step with them gains little; a row stops where a step with fresh ones gains less than
    `CHAOS`.
    known : derivatives at points on these windows, which such a fit begins with and leaves for the next one.
    """
    if leading is None and model.dear:
        known = {} if known is None else known
        least = max(tolerance, CHAOS)
        return (yield from _carried(model, points, sample, known, iterations, least, hopeless))
    points, sides = list(points), model.accuracy.sides
    residuals = yield from model.residuals(points, sample)
    cost = objective(points, residuals, sample)
    going, idle = np.arange(len(points)), np.zeros(len(points), dtype=int)
    for iteration in range(iterations):
        if iteration >= 2:
            going = going[cost[going] <= cost.min() + hopeless]
        if not len(going):
            break
        now = [points[i] for i in going]
        slope = yield from slopes(model, now, sample, leading, side=iteration % sides)
        tries: list[Point] = []
        for i, own in zip(going, slope, strict=True):
            ahead = steps(model, points[i], residuals[i], own, sample)
            tries += ahead if leading is None else [ahead[k] for k in FEWER]
        made = yield from model.residuals(tries, sample)
        costs = objective(tries, made, sample).reshape(len(going), -1)
        best = costs.argmin(axis=1)
        gained = cost[going] - costs[np.arange(len(going)), best]
        for row, i in enumerate(going):
            if gained[row] > 0:
                at = row * costs.shape[1] + best[row]
                points[i], residuals[i], cost[i] = tries[at], made[at], costs[row, best[row]]
        idle[going] = np.where(gained > tolerance, 0, idle[going] + 1)
        going = going[idle[going] < sides]
    return points, cost


def _carried(
    model: Model,
    points: Sequence[Point],
    sample: Sample,
    known: dict[Point, np.ndarray],
    iterations: int,
    tolerance: float,
    hopeless: float,
) -> Search[Fitted]:
    """`fit` with derivatives that are carried on from step to step, and shared between points that are near."""
    points = list(points)
    residuals = yield from model.residuals(points, sample)
    cost = objective(points, residuals, sample)
    going, lately = np.arange(len(points)), np.zeros(len(points))
    for iteration in range(iterations):
        if iteration >= 2:
            going = going[cost[going] <= cost.min() + hopeless]
        if not len(going):
            break
        anew = [i for i in going if points[i] not in known]
        side = iteration % model.accuracy.sides
        made = yield from _shared(model, [points[i] for i in anew], sample, side)
        known |= {points[i]: slope for i, slope in zip(anew, made, strict=True)}
        tries = [p for i in going for p in steps(model, points[i], residuals[i], known[points[i]], sample)]
        made = yield from model.residuals(tries, sample)
        costs = objective(tries, made, sample).reshape(len(going), -1)
        stopped = []
        for row, i in enumerate(going):
            best = int(costs[row].argmin())
            before, at = cost[i], row * costs.shape[1] + best
            if costs[row, best] < before:
                slope = known.pop(points[i])
                known[tries[at]] = carried(slope, tries[at].z - points[i].z, made[at] - residuals[i])
                points[i], residuals[i], cost[i] = tries[at], made[at], costs[row, best]
            gained = before - cost[i]
            if i in anew:
                lately[i] = gained
                if not gained > tolerance:
                    stopped.append(i)
            elif not gained > max(tolerance, SLOWER * lately[i]):
                del known[points[i]]
        going = np.setdiff1d(going, stopped)
    return points, cost


def _shared(model: Model, points: list[Point], sample: Sample, side: int) -> Search[list[np.ndarray]]:
    """Of each point the derivatives; points near another one take over those of its nominal coordinates."""
    own: list[np.ndarray | None] = [None] * len(points)
    for number, lead in enumerate(near_another(points)):
        leading = None if lead == number else own[lead][: len(points[lead].nominal)]
        (own[number],) = yield from slopes(model, [points[number]], sample, leading, side=side)
    return own


def carried(slope: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Derivatives (D, W, T, C) after a step (D,) that changed the residual by `change` (W, T, C).

    The least change of derivatives that explains it (Broyden, Math. Comput. 19, 1965).
    """
    missed = change - np.tensordot(step, slope, axes=1)
    return slope + np.multiply.outer(step / max(step @ step, 1e-12), missed)


def best_of(points: Sequence[Point], cost: np.ndarray, count: int | None = None) -> list[Point]:
    """The points by their cost (n,), the lowest first; `count` of them, or all."""
    return [points[i] for i in np.argsort(cost, kind="stable")[:count]]


def steps(model: Model, point: Point, residual: np.ndarray, slope: np.ndarray, sample: Sample) -> list[Point]:
    """Points to try next, one for each damping; coordinates that a bound stops are left out of the step."""
    curvature, downhill = information(point, residual, slope, sample)
    prior = point.prior
    limits = bounds(model.coordinates, point.hypothesis)
    z = point.z
    stuck = ((z <= limits[:, 0] + 1e-9) & (downhill < 0)) | ((z >= limits[:, 1] - 1e-9) & (downhill > 0))
    move = np.flatnonzero(~stuck)
    out = []
    for damping, pull in [*((d, 0.0) for d in DAMPINGS), *((DAMPINGS[0], p) for p in PULLS)]:
        step = np.zeros(len(z))
        if len(move):
            matrix = (curvature + pull * np.diag(prior))[np.ix_(move, move)]
            matrix = matrix + damping * np.diag(np.diag(matrix)) + 1e-9 * np.eye(len(move))
            towards = (downhill - pull * prior * z)[move]
            step[move] = np.linalg.lstsq(matrix, towards, rcond=1e-12)[0]
            step *= min(1.0, REACH / max(np.abs(step).max(), 1e-12))  # shorter, but in the same direction
        out.append(step)
    out += [share * out[0] for share in SHARES]
    return [point.moved(np.clip(z + step, limits[:, 0], limits[:, 1])) for step in out]

"""Fit: regularised Gauss-Newton on rollouts, for all hypotheses and starts at once, derivatives by differences.

Minimises  sum over windows (n_eff / 2) log(mean squared residual)  +  the prior's penalty: the negative logarithm
of the posterior when the residual's size is unknown. Every iteration simulates all perturbed candidates of all
rows as one batch.
"""

import numpy as np

from dynreg.diagnose.hypothesis import effect_bounds
from dynreg.diagnose.problem import Point, Problem, log_likelihood, mean_squares

# Central differences in fit coordinates: wide, for dry friction has kinks; one-sided ones are too biased to walk along
# the valleys in which masses, gains and inertias make up for each other. Of a floating base on its feet they are
# one-sided all the same: slips bend its rollouts more than the bias does, and it takes half the time.
STEP = 0.07
ROUGH = 1.0  # where feet stick and slip: the rollouts are rough on a smaller scale
WIDER, UNEVEN = 0.3, 0.3  # derivatives over this width and over STEP differ by more than this share there
SIDES = 2  # of a floating base's differences: towards the nameplate, and from it
ROOM = 0.3  # of the width, that a bound must leave for a difference to that side
DAMPINGS = (1e-5, 1e-2, 1.0)  # relative to the curvature of each coordinate
PULLS = (30.0,)  # times the prior: steps along valleys that the data hardly sees, back to the nameplate
REACH = 2.0  # largest change of a coordinate in one iteration
SHARES = (2.0, 0.4, 0.15)  # of the boldest step, tried too: valleys are long, and bent
FEWER = (0, 2, 3, 5)  # of all these steps, those tried where derivatives are only roughly known


def fit(
    problem: Problem,
    points: list[Point],
    chosen: np.ndarray,
    effective: np.ndarray,
    *,
    iterations: int = 4,
    tolerance: float = 0.3,
    leading: np.ndarray | None = None,
    hopeless: float = np.inf,
) -> tuple[list[Point], np.ndarray]:
    """Improve every point on the windows `chosen`.

    effective : (W, C) independent samples of each window and channel. leading : (L, W, T, C) derivatives of the first
    L coordinates where they are known well enough: only the others are measured, and fewer steps are tried.
    Returns the points and their objective (n,), lower is better [nats]. A row stops when an iteration (of a floating
    base: one with derivatives to either side) gains less than `tolerance`, or when after two of them it is more than
    `hopeless` [nats] behind the best.
    """
    points = list(points)
    residuals = problem.residuals(points, chosen)
    cost = objective(problem, points, residuals, effective)
    going, idle = np.arange(len(points)), np.zeros(len(points), dtype=int)
    for iteration in range(iterations):
        if iteration >= 2:
            going = going[cost[going] <= cost.min() + hopeless]
        if not len(going):
            break
        slopes = _slopes(problem, [points[i] for i in going], chosen, leading, side=iteration % SIDES)
        tries: list[Point] = []
        for i, slope in zip(going, slopes, strict=True):
            steps = _steps(problem, points[i], residuals[i], slope, effective)
            tries += steps if leading is None else [steps[k] for k in FEWER]
        made = problem.residuals(tries, chosen)
        costs = objective(problem, tries, made, effective).reshape(len(going), -1)
        best = costs.argmin(axis=1)
        gained = cost[going] - costs[np.arange(len(going)), best]
        for row, i in enumerate(going):
            if gained[row] > 0:
                at = row * costs.shape[1] + best[row]
                points[i], residuals[i], cost[i] = tries[at], made[at], costs[row, best[row]]
        idle[going] = np.where(gained > tolerance, 0, idle[going] + 1)
        going = going[idle[going] < (SIDES if problem.stands else 1)]
    return points, cost


def polish(
    problem: Problem,
    points: list[Point],
    chosen: np.ndarray,
    *,
    iterations: int,
    tolerance: float = 3.0,
    hopeless: float = np.inf,
) -> tuple[list[Point], np.ndarray]:
    """The points improved by rollouts with the finer time step, which alone says what time steps do to contacts.

    Derivatives, and which of the steps is best, come from the usual time step; that step and half of it are tried with
    the finer one. Independent samples are those of each point's own residual, anew after the second iteration.
    Returns the points and their residuals (n, W, T, C) with the finer one. A point, other than the first, stops when
    after an iteration it is more than `hopeless` [nats] behind the best.
    """
    points = list(points)
    residuals = problem.fine.residuals(points, chosen)
    going = np.arange(len(points))
    for number in range(iterations):
        if number in (0, 2):
            effective = [problem.effective(r) for r in residuals]
        now = [points[i] for i in going]
        moved = _promising(problem, now, chosen, residuals[going], effective, going)
        made = problem.fine.residuals(moved, chosen)
        gained = np.zeros(len(going))
        for row, i in enumerate(going):
            of = slice(2 * row, 2 * row + 2)
            three = np.concatenate([residuals[i : i + 1], made[of]])
            costs = objective(problem, [points[i], *moved[of]], three, effective[i])
            best = int(costs.argmin())
            points[i], residuals[i] = [points[i], *moved[of]][best], three[best]
            gained[row] = costs[0] - costs[best]
        if number >= 2:
            going = going[gained > tolerance]
        cost = objective(problem, points, residuals, effective[0])
        going = going[(cost[going] <= cost.min() + hopeless) | (going == 0)]
        if not len(going):
            break
    return points, residuals


def _promising(
    problem: Problem,
    points: list[Point],
    chosen: np.ndarray,
    residuals: np.ndarray,
    effective: list[np.ndarray],
    numbers: np.ndarray,
) -> list[Point]:
    """Of each point the best step by the usual time step, and half of it; `residuals` are of the finer one."""
    slopes = _slopes(problem, points, chosen)
    tries = [
        _steps(problem, p, r, s, effective[i])
        for p, r, s, i in zip(points, residuals, slopes, numbers, strict=True)
    ]
    made = problem.residuals([*points, *(t for own in tries for t in own)], chosen)
    out, at = [], len(points)
    for row, own in enumerate(tries):
        likely = made[at : at + len(own)] - made[row] + residuals[row]
        far = own[int(objective(problem, own, likely, effective[numbers[row]]).argmin())]
        out += [far, points[row].moved(0.5 * (points[row].z + far.z))]
        at += len(own)
    return out


def known_near(problem: Problem, point: Point, many: int, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """What fits of points near this one share: independent samples, derivatives by the first `many` coordinates."""
    residual, slopes = sensitivities(problem, [point], chosen)
    return {"effective": problem.effective(residual[0]), "leading": slopes[0][:many]}


def uneven(problem: Problem, point: Point, chosen: np.ndarray) -> bool:
    """Whether derivatives over a narrow and over a wide difference have little in common."""
    narrow, wide = (np.nan_to_num(_slopes(problem, [point], chosen, step=s)[0]) for s in (STEP, WIDER))
    return bool(np.linalg.norm(narrow - wide) > UNEVEN * np.linalg.norm(wide))


def objective(
    problem: Problem, points: list[Point], residuals: np.ndarray, effective: np.ndarray
) -> np.ndarray:
    """(n,) negative log posterior of points with residuals (n, W, T, C)."""
    penalty = np.array([p.penalty for p in points])
    return penalty - log_likelihood(mean_squares(residuals, problem.floor), effective)


def sensitivities(
    problem: Problem, points: list[Point], chosen: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Residuals (n, W, T, C) of the points, and of each its derivatives (P' + K, W, T, C)."""
    residuals = problem.residuals(points, chosen)
    return residuals, _slopes(problem, points, chosen)


def bounds(problem: Problem, point: Point) -> np.ndarray:
    """(P' + K, 2) lowest and highest coordinates."""
    return np.concatenate([problem.coordinates.nominal_bounds, effect_bounds(point.hypothesis)])


def information(
    problem: Problem, point: Point, residual: np.ndarray, slope: np.ndarray, effective: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Curvature (D, D) and downhill direction (D,) of the objective at a point, D = P' + K."""
    weight = effective / mean_squares(residual[None], problem.floor)[0]
    count = np.maximum(np.isfinite(residual).sum(axis=1), 1)
    weight = np.where(np.isfinite(weight), weight, 0.0) / count  # (W, C) of each sample
    r = np.nan_to_num(residual)
    j = np.nan_to_num(slope)
    weighted = (j * weight[None, :, None, :]).reshape(len(j), -1)
    curvature = weighted @ j.reshape(len(j), -1).T
    downhill = -weighted @ r.reshape(-1)
    return curvature + np.diag(point.prior), downhill - point.prior * point.z


def _slopes(
    problem: Problem,
    points: list[Point],
    chosen: np.ndarray,
    leading: np.ndarray | None = None,
    step: float | None = None,
    side: int = 0,
) -> list[np.ndarray]:
    """Of each point the derivatives (P' + K, W, T, C) of its residuals; the `leading` ones are taken as they are.

    step : the difference's half width, and the whole one of a floating base's, which are taken to one side; by default
    as the rollouts are rough or not. side : that side, 0 towards the nameplate, 1 from it.
    """
    first = 0 if leading is None else len(leading)
    step = step or (ROUGH if problem.rough else STEP)
    ends = [_ends(problem, point, step, side) for point in points]
    moved = []
    for point, (one, two) in zip(points, ends, strict=True):
        for i in range(first, len(point.z)):
            for end in (one,) if problem.stands else (one, two):
                z = point.z.copy()
                z[i] = end[i]
                moved.append(point.moved(z))
    here = list(points) if problem.stands else []
    made = problem.sloped.residuals([*here, *moved], chosen)
    out, at = [], len(here)
    for number, (point, (one, two)) in enumerate(zip(points, ends, strict=True)):
        own = made[at:][: (len(point.z) - first) * (1 if problem.stands else 2)]
        change = own - made[number] if problem.stands else own[::2] - own[1::2]
        width = (one - two)[first:]
        slope = change / np.where(np.abs(width) > 1e-9, width, 1e-9)[:, None, None, None]
        out.append(slope if leading is None else np.concatenate([leading, slope]))
        at += len(own)
    return out


def _ends(problem: Problem, point: Point, step: float, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (D,), first and second, whose residuals' difference is taken: `step` to both sides, within bounds.

    A floating base's: `step` to the side, or to the other one where a bound leaves too little, and where the point is.
    """
    limits = bounds(problem, point)
    up, down = np.minimum(point.z + step, limits[:, 1]), np.maximum(point.z - step, limits[:, 0])
    if not problem.stands:
        return up, down
    upwards = (point.z > 0) == bool(side)
    this, other = np.where(upwards, up, down), np.where(upwards, down, up)
    room, rest = np.abs(this - point.z), np.abs(other - point.z)
    return np.where(room > np.minimum(ROOM * step, rest), this, other), point.z


def _steps(
    problem: Problem, point: Point, residual: np.ndarray, slope: np.ndarray, effective: np.ndarray
) -> list[Point]:
    """Points to try next, one for each damping; coordinates that a bound stops are left out of the step."""
    curvature, downhill = information(problem, point, residual, slope, effective)
    prior = point.prior
    limits = bounds(problem, point)
    z = point.z
    stuck = ((z <= limits[:, 0] + 1e-9) & (downhill < 0)) | ((z >= limits[:, 1] - 1e-9) & (downhill > 0))
    move = np.flatnonzero(~stuck)
    steps = []
    for damping, pull in [*((d, 0.0) for d in DAMPINGS), *((DAMPINGS[0], p) for p in PULLS)]:
        step = np.zeros(len(z))
        if len(move):
            matrix = (curvature + pull * np.diag(prior))[np.ix_(move, move)]
            matrix = matrix + damping * np.diag(np.diag(matrix)) + 1e-9 * np.eye(len(move))
            towards = (downhill - pull * prior * z)[move]
            step[move] = np.linalg.lstsq(matrix, towards, rcond=1e-12)[0]
            step *= min(1.0, REACH / max(np.abs(step).max(), 1e-12))  # shorter, but in the same direction
        steps.append(step)
    steps += [share * steps[0] for share in SHARES]
    return [point.moved(np.clip(z + step, limits[:, 0], limits[:, 1])) for step in steps]

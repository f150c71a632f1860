"""Calibrate: the model without a cause at its maximum a posteriori."""

import numpy as np

from dynreg.diagnose.effort import FULL
from dynreg.diagnose.fit import fit, uneven
from dynreg.diagnose.problem import Point, Problem
from dynreg.rng import stream


def calibrate(
    problem: Problem, fit_on: np.ndarray, *, iterations: int = 8, draws: int = FULL.draws, seed: int = 0
) -> tuple[Point, np.ndarray]:
    """The model that a search begins with, fitted a posteriori, and the independent samples (W, C) of its residual.

    Starts at the nameplate and at `draws` from its tolerances: dry friction makes local optima.
    """
    start, many = problem.start, len(problem.coordinates)
    apart = stream(seed, "calibrate").standard_normal((draws, many))
    points = [Point(start.hypothesis, z, start.effect) for z in (start.nominal, *apart)]
    problem.rough = problem.rough or (problem.coarse and uneven(problem, points[0], fit_on))
    effective = np.full((len(fit_on) * problem.segments, len(problem.use)), 20.0 / problem.segments)
    if problem.rough:  # what the time step does to contacts leads the fit astray from its start
        problem.refine(points[:1], np.arange(len(problem.windows)))
    points, cost = fit(problem, points, fit_on, effective, iterations=3)
    for rounds, kept in ((3, 2), (iterations, 1)) if draws else ((iterations, 1),):
        points = [points[i] for i in np.argsort(cost, kind="stable")[:kept]]
        effective = problem.effective(problem.residuals(points[:1], fit_on)[0])
        points, cost = fit(problem, points, fit_on, effective, iterations=rounds, tolerance=0.05)
        if kept == 1 and problem.coarse:
            problem.refine(points, np.arange(len(problem.windows)))
            points, cost = fit(problem, points, fit_on, effective, iterations=rounds, tolerance=0.05)
    return points[0], problem.effective(problem.residuals(points[:1], fit_on)[0])

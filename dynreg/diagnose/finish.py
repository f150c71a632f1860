"""Finish: where rollouts are rough, the best of a long list and the model without a term by finer time steps."""

import numpy as np

from dynreg.diagnose.effort import Effort
from dynreg.diagnose.fit import fit, known_near, objective, polish
from dynreg.diagnose.problem import Point, Problem

FINE = 8  # of a long list, where rollouts are rough: those that are refitted with a finer time step,
SHARED = 1  # by so many iterations with shared derivatives,
FINISHED = 3  # and those that are polished with their own,
POLISHED = 3  # by so many
# Of a floating base on its feet: terms that take one step by the finer time step on the windows to fit, those of them
# that take one on all windows, and those that take three more. The numbers are what two minutes allow.
STANDING = (6, 4, 3)
AWAY = 300.0  # nats behind the best, from which a term does not take these three
CHAOS = 5.0  # nats that an iteration must gain for another one: less is a foot that slips a moment earlier
HOPELESS = 60.0  # nats behind the best, from which a hypothesis is not fitted to the end


def finished(
    problem: Problem, start: Point, fitted: list[Point], fit_on: np.ndarray, select_on: np.ndarray
) -> tuple[Point, list[Point]]:
    """The model without the term and those with it, refitted with finer time steps, best first.

    First all share the derivatives by the nominal parameters of the best, then the best are polished with their own.
    The model without the term starts where one of them ended, too, and is chosen as they are: by all windows.
    """
    fine, fitted = problem.fine, fitted[:FINE]
    known = known_near(fine, fitted[0], len(start.nominal), fit_on)
    fitted, cost = fit(fine, fitted, fit_on, iterations=SHARED, **known)
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")[:FINISHED]]
    (start, *fitted), residuals = polish(
        problem, [start, *fitted], fit_on, iterations=POLISHED, hopeless=HOPELESS
    )
    cost = objective(problem, fitted, residuals[1:], problem.effective(residuals[1]))
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")]
    windows = np.concatenate([fit_on, select_on])
    rivals = [Point(start.hypothesis, p.nominal, p.effect[: len(start.effect)]) for p in fitted]
    rival = _best(fine, rivals, windows)
    return _best(fine, [start, *polish(problem, [rival], fit_on, iterations=POLISHED)[0]], windows), fitted


def standing(
    problem: Problem,
    start: Point,
    fitted: list[Point],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    effort: Effort,
) -> tuple[Point, list[Point]]:
    """As `finished`, of a floating base on its feet: fitted on all windows, all steps tried with the finer time step.

    On half of the windows wrong causes fit what disturbs them better than the true one does, and the usual time step's
    derivatives stop far from the optimum, that of the model without the term above all: what it lacks any cause gains.
    """
    fine, windows = problem.fine, np.concatenate([fit_on, select_on])
    effective = problem.effective(fine.residuals([start], windows)[0])
    first = effective[: len(fit_on) * problem.segments]

    def best(points: list[Point], many: int) -> list[Point]:
        cost = objective(problem, points, fine.residuals(points, windows), effective)
        return [points[i] for i in np.argsort(cost, kind="stable")[:many]]

    fitted, _ = fit(fine, fitted[: STANDING[0]], fit_on, first, iterations=1)
    fitted, cost = fit(fine, best(fitted, STANDING[1]), windows, effective, iterations=1)
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")]
    close = min(int((cost <= cost.min() + AWAY).sum()), STANDING[2])
    ahead, _ = fit(fine, fitted[:close], windows, effective, iterations=3, tolerance=CHAOS, hopeless=HOPELESS)
    fitted = best([*ahead, *fitted[close:]], len(fitted))
    (start,), _ = fit(fine, [start], windows, effective, iterations=effort.alone, tolerance=CHAOS)
    rival = Point(start.hypothesis, fitted[0].nominal, fitted[0].effect[: len(start.effect)])
    (rival,), _ = fit(fine, [rival], windows, effective, iterations=effort.rival, tolerance=CHAOS)
    return best([start, rival], 1)[0], fitted


def _best(problem: Problem, points: list[Point], windows: np.ndarray) -> Point:
    """The point with the lowest objective on all these windows."""
    residuals = problem.residuals(points, windows)
    return points[int(objective(problem, points, residuals, problem.effective(residuals[0])).argmin())]

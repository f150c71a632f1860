"""Name the cause: screen, refit, score; one round."""

import numpy as np

from dynreg.diagnose.effort import FULL, Effort
from dynreg.diagnose.finish import HOPELESS, finished, standing
from dynreg.diagnose.fit import fit
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.score import Naming, select
from dynreg.diagnose.screen import screen
from dynreg.diagnose.shortlist import shortlisted
from dynreg.sim.effects import Term

FINALISTS = (
    16  # points that are fitted to the end: the best of each hypothesis, and others where there is room
)
ROUNDS = 2  # of naming, where the first found a better model without the term on its way:
BETTER = 2.0  # nats better


def name_one(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    effective: np.ndarray,
    *,
    effort: Effort = FULL,
) -> Naming:
    """The term that, added to `base`, explains most of what `base` leaves: one round of naming.

    effective : (W, C) independent samples of the fit windows.
    """
    many = len(terms) > effort.long
    for _ in range(ROUNDS):
        naming = _one_round(problem, base, terms, fit_on, select_on, effective, many, effort)
        base = naming.start.point
        if not naming.improved or not naming.ranking:
            break
        if many:  # the best of a long list stay the best
            terms = [scored.point.hypothesis.terms[-1] for scored in naming.ranking]
    return naming


def _one_round(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    effective: np.ndarray,
    many: bool,
    effort: Effort,
) -> Naming:
    """The round from one `base`: what is fitted, and what of it is chosen."""
    if many:
        if problem.rough and base.hypothesis.keys not in problem.corrections:
            problem.refine([base], np.arange(len(problem.windows)))
        fitted = shortlisted(problem, base, terms, fit_on, effective, HOPELESS, effort)
    else:
        starts, slopes = screen(problem, base, terms, fit_on, effective)
        rough, cost = fit(problem, starts, fit_on, effective, iterations=1, leading=slopes)
        order, first = np.argsort(cost, kind="stable"), {}
        for i in order:
            first.setdefault(rough[i].hypothesis.key, i)
        # the best start of each hypothesis, best first; then the others
        best = [*first.values(), *(i for i in order if i not in first.values())][:FINALISTS]
        best = [rough[i] for i in best]
        fitted, _ = fit(problem, best, fit_on, effective, iterations=effort.iterations, hopeless=HOPELESS)
    if many and problem.stands:
        start, fitted = standing(problem, base, fitted, fit_on, select_on, effort)
        return select(problem.fine, start, fitted, fit_on, select_on, together=True)
    # the model without the term gets the same chance: it starts where the best of the others ended, too
    rivals = fitted[: 1 if many else 3]
    others = [base, *(Point(base.hypothesis, p.nominal, p.effect[: len(base.effect)]) for p in rivals)]
    again, price = fit(problem, others, fit_on, effective, iterations=2 if many else effort.iterations)
    start = again[int(price.argmin())]
    improved = float(price[0] - price.min()) > BETTER
    if many and problem.rough:
        improved = False  # all are refitted from where they are by now
        start, fitted = finished(problem, start, fitted, fit_on, select_on)
        naming = select(problem.fine, start, fitted, fit_on, select_on)
    else:
        naming = select(problem, start, fitted, fit_on, select_on)
    naming.improved = improved
    return naming

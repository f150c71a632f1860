"""How large the cause may be that is looked at most closely, alone and beside the neighbours that are most like it."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose import apart
from dynreg.diagnose.diagnose import Found, offered
from dynreg.diagnose.fit import fit
from dynreg.diagnose.interval import Posterior, posterior
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.settle import unlike
from dynreg.sim.effects import Term

SIZES = (0.3, 1.0, 2.5, 5.0)  # medium sizes from which a cause that was asked for, and not found, is fitted


@dataclass(frozen=True)
class Look:
    """A cause, the last term of `point`, with draws of it alone and beside each of its rivals."""

    point: Point
    draws: Posterior
    beside: tuple[apart.Together, ...]

    @property
    def cause(self) -> Term:
        """What is looked at."""
        return self.point.hypothesis.terms[-1]


def look(
    problem: Problem, found: Found, extended: Posterior, chosen: np.ndarray, options: DiagnosisOptions
) -> Look | None:
    """At the first cause, or without one at the only effect asked for, or at the best ranked.

    extended : draws of the extended simulator. None where nothing was ranked.
    """
    if found.accepted:
        point, draws = _last(found.extended, extended)
    else:
        point = _subject(problem, found, chosen, options)
        if point is None:
            return None
        draws = posterior(problem, point, chosen, seed=options.seed)
    others = {term.key for term in point.hypothesis.terms}
    terms = [t for t in offered(problem, replace(options, effects=None)) if t.key not in others]
    near = apart.neighbours(problem.robot, point.hypothesis.terms[-1], terms)
    return Look(point, draws, apart.together(problem, point, draws, near, chosen, options.seed))


def _subject(problem: Problem, found: Found, chosen: np.ndarray, options: DiagnosisOptions) -> Point | None:
    """Where nothing was named: the point whose last term is looked at."""
    if options.effects is not None and len(options.effects) == 1:
        term = next(iter(unlike(problem.robot, offered(problem, options), found.base.hypothesis.terms)), None)
    elif found.rounds and found.rounds[-1].ranking:
        term = found.rounds[-1].ranking[0].point.hypothesis.terms[-1]
    else:
        term = None
    if term is None:
        return None
    starts = [apart.with_term(found.base, term, size) for size in SIZES]
    starts += [Point(s.hypothesis, np.zeros(len(s.nominal)), s.effect) for s in starts]
    effective = problem.effective(problem.residuals([found.base], chosen)[0])
    points, cost = fit(problem, starts, chosen, effective)
    return points[int(cost.argmin())]


def _last(point: Point, draws: Posterior) -> tuple[Point, Posterior]:
    """The same point and draws with the first cause at the end."""
    given, terms, free = point.hypothesis.given, point.hypothesis.terms, len(point.nominal)
    hypothesis = replace(point.hypothesis, terms=(*terms[:given], *terms[given + 1 :], terms[given]))
    own = free + np.r_[point.hypothesis.columns(given)]
    order = np.append(np.delete(np.arange(len(point.z)), own), own)
    turned = Point(hypothesis, point.nominal, point.z[order][free:])
    return turned, replace(draws, hypothesis=hypothesis, z=draws.z[:, order])

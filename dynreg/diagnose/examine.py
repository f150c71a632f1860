"""The examined cause: intervals of its size alone, and with each of its most similar rivals."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose import separability
from dynreg.diagnose.diagnose import offered
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.settle import unlike
from dynreg.evidence.data import Sample
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.interval import Posterior, posterior
from dynreg.evidence.lockstep import Search
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term

BEGUN, KEPT = 1, 2  # iterations of all its starts, and the number of starts that are fitted to the end
# The sizes of the screening and a larger one: an effect may be large, and hidden by nominal parameters.
SIZES = (
    0.3,
    1.0,
    2.5,
    5.0,
)  # medium sizes from which the fit of a requested effect that was not named starts


@dataclass(frozen=True)
class Examined:
    """A cause (the last term of `point`) with posterior draws of it alone, and with each of its rivals."""

    point: Point
    draws: Posterior
    beside: tuple[separability.PairFit, ...]

    @property
    def cause(self) -> Term:
        """The examined term."""
        return self.point.hypothesis.terms[-1]


def examine(
    found: State, extended: Posterior, sample: Sample, options: DiagnosisOptions
) -> Search[Examined | None]:
    """Examine the first cause; without one the only requested effect, or the best ranked. None if nothing was ranked.

    extended : draws of the extended simulator.
    """
    model = found.model
    if found.accepted:
        point, draws = _last(found.current, extended)
    else:
        point = yield from _subject(found, sample, options)
        if point is None:
            return None
        draws = yield from posterior(model, point, sample, seed=options.seed)
    others = {term.key for term in point.hypothesis.terms}
    terms = [t for t in offered(model, found.data, replace(options, effects=None)) if t.key not in others]
    near = separability.neighbours(model.robot, point.hypothesis.terms[-1], terms)
    return Examined(
        point, draws, (yield from separability.fit_pairs(model, point, draws, near, sample, options.seed))
    )


def _subject(found: State, sample: Sample, options: DiagnosisOptions) -> Search[Point | None]:
    """The point whose last term is examined if no cause was named."""
    model, base = found.model, found.base
    if options.effects is not None and len(options.effects) == 1:
        term = next(
            iter(unlike(model.robot, offered(model, found.data, options), base.hypothesis.terms)), None
        )
    elif found.rounds and found.rounds[-1].ranking:
        term = found.rounds[-1].ranking[0].point.hypothesis.terms[-1]
    else:
        term = None
    if term is None:
        return None
    starts = [separability.with_term(base, term, size) for size in SIZES]
    starts += [Point(s.hypothesis, np.zeros(len(s.nominal)), s.effect) for s in starts]
    sample = sample.reweighted((yield from model.residuals([base], sample))[0])
    begun = yield from fit(model, starts, sample, iterations=BEGUN)
    return best_of(*(yield from fit(model, best_of(*begun, KEPT), sample)))[0]


def _last(point: Point, draws: Posterior) -> tuple[Point, Posterior]:
    """The same point and draws with the first cause at the end."""
    given, terms, free = point.hypothesis.given, point.hypothesis.terms, len(point.nominal)
    hypothesis = replace(point.hypothesis, terms=(*terms[:given], *terms[given + 1 :], terms[given]))
    own = free + np.r_[point.hypothesis.columns(given)]
    order = np.append(np.delete(np.arange(len(point.z)), own), own)
    turned = Point(hypothesis, point.nominal, point.z[order][free:])
    return turned, replace(draws, hypothesis=hypothesis, z=draws.z[:, order])

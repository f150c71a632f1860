"""The pairs of causes that a diagnosis reports as not told apart, and the experiment that separates each."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dynreg.diagnose import apart
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.fit import fit
from dynreg.diagnose.hypothesis import Hypothesis, single_terms
from dynreg.diagnose.interval import Posterior, posterior
from dynreg.diagnose.joints import terms_at
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.shown import shown
from dynreg.results.diagnosis import EffectEstimate, Inseparable, Looked
from dynreg.sim.effects import Term

if TYPE_CHECKING:
    from dynreg.diagnose.diagnose import Found
    from dynreg.diagnose.settings import Settings

SIZES = (0.3, 1.0, 2.5, 5.0)  # medium sizes from which a cause that was asked for, and not found, is fitted


def tied(
    problem: Problem, found: "Found", extended: Posterior, chosen: np.ndarray, settings: "Settings"
) -> tuple[Looked | None, tuple[Inseparable, ...]]:
    """What was looked at: the first cause, or without one the only effect asked for, or the best ranked; and its rivals
    that cannot be told from it.

    extended : draws of the extended simulator.
    """
    if found.accepted:
        subject, draws = _last(found.extended, extended)
    else:
        subject = _subject(problem, found, chosen, settings)
        if subject is None:
            return None, ()
        draws = posterior(problem, subject, chosen, seed=settings.seed)
    cause = subject.hypothesis.terms[-1]
    others = {term.key for term in subject.hypothesis.terms}
    terms = [t for t in _offered(problem, settings) if t.key not in others]
    number = len(subject.hypothesis.terms) - 1
    alone = estimates(problem, subject, number, draws, median=True)
    both = apart.together(
        problem, subject, draws, apart.neighbours(problem.robot, cause, terms), chosen, settings.seed
    )
    with_rivals = [estimates(problem, one.point, number, one.draws, median=True) for one in both]
    looked = Looked(
        effect=cause.effect.id,
        joints=cause.joints,
        rivals=tuple(one.pair[1].key for one in both),
        alone=alone,
        whatever={name: _widest([alone[name], *(e[name] for e in with_rivals)]) for name in alone},
    )
    return looked, tuple(
        _said(problem, one, inside, _proven(found, one))
        for one, inside in zip(both, with_rivals, strict=True)
        if one.inseparable
    )


def _subject(problem: Problem, found: "Found", chosen: np.ndarray, settings: "Settings") -> Point | None:
    """Where nothing was named: the point whose last term is looked at."""
    if settings.effects is not None and len(settings.effects) == 1:
        (term,) = _offered(problem, settings, settings.effects)[:1]
    elif found.rounds and found.rounds[-1].ranking:
        term = found.rounds[-1].ranking[0].point.hypothesis.terms[-1]
    else:
        return None
    starts = [apart.with_term(found.base, term, size) for size in SIZES]
    starts += [Point(s.hypothesis, np.zeros(len(s.nominal)), s.effect) for s in starts]
    effective = problem.effective(problem.residuals([found.base], chosen)[0])
    points, cost = fit(problem, starts, chosen, effective)
    return points[int(cost.argmin())]


def _offered(problem: Problem, settings: "Settings", only: tuple[str, ...] = ()) -> list[Term]:
    """The terms that the diagnosis could name: at the joints that it looks at, and in no measured input."""
    held = shown(problem.robot, problem.windows)
    terms = single_terms(problem.robot, only, (*settings.without, *held))
    return terms_at(terms, settings.joints) if settings.joints else terms


def _last(point: Point, draws: Posterior) -> tuple[Point, Posterior]:
    """The same point and draws with the first term at the end."""
    first, *rest = point.hypothesis.terms
    hypothesis, many, free = Hypothesis((*rest, first)), len(first.effect.parameters), len(point.nominal)
    effect = np.roll(draws.z[:, free:], -many, axis=1)
    return (
        Point(hypothesis, point.nominal, np.roll(point.effect, -many)),
        replace(draws, hypothesis=hypothesis, z=np.concatenate([draws.z[:, :free], effect], axis=1)),
    )


def _widest(every: list[EffectEstimate]) -> EffectEstimate:
    """The first estimate with an interval that holds all of theirs."""
    return every[0].model_copy(update={"low": min(e.low for e in every), "high": max(e.high for e in every)})


def _said(
    problem: Problem, found: apart.Together, inside: dict[str, EffectEstimate], proven: bool
) -> Inseparable:
    cause, rival = found.pair
    number = len(found.point.hypothesis.terms) - 1
    return Inseparable(
        between=(cause.key, rival.key),
        cause=inside,
        rival=estimates(problem, found.point, number, found.draws, median=True),
        growth=found.growth,
        absent=not proven and _may_be_absent(cause, inside),
        experiment=_command(problem.robot.name, cause.key, rival.key),
    )


def _proven(found: "Found", one: apart.Together) -> bool:
    """Whether the cause has been named, and the rival alone explains the data less well: it is there."""
    equals = (
        {s.point.hypothesis.terms[-1].key for s in found.rounds[0].equivalent} if found.accepted else set()
    )
    return found.accepted > 0 and one.pair[1].key not in equals


def _may_be_absent(term: Term, said: dict[str, EffectEstimate]) -> bool:
    """Whether every interval holds a size that is not worth naming (half the weak one)."""
    sized = [(said[p.name], p.inverse) for p in term.effect.parameters if not p.shape]
    return all(
        not inverse and e.low <= 0.5 * e.sizes[0] and e.high >= -0.5 * e.sizes[0] for e, inverse in sized
    )


def _command(robot: str, first: str, second: str) -> str:
    pair = f"'{first},{second}'" if "[" in first + second else f"{first},{second}"
    return f"dynreg excite {robot} --for {pair} -o next.csv"

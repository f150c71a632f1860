"""How large the cause may be that a diagnosis looked at most closely, and the rivals that it cannot be told from."""

from dynreg.diagnose.account import Account
from dynreg.diagnose.apart import Together
from dynreg.diagnose.diagnose import Diagnosed, Found
from dynreg.diagnose.estimate import Estimate, estimates
from dynreg.results.diagnosis import EffectEstimate, Inseparable, Looked
from dynreg.sim.effects import Term
from dynreg.verbs.diagnosis_words import excite_command


def looked(made: Diagnosed, seen: Account) -> Looked | None:
    """The first cause, or without one that asked for, or the best ranked; None where nothing was ranked."""
    look, problem = seen.look, made.found.problem
    if look is None:
        return None
    number = len(look.point.hypothesis.terms) - 1
    alone = estimates(problem, look.point, number, look.draws, median=True)
    beside = [estimates(problem, one.point, number, one.draws, median=True) for one in look.beside]
    return Looked(
        effect=look.cause.effect.id,
        joints=look.cause.joints,
        rivals=tuple(one.pair[1].key for one in look.beside),
        alone=_told(alone),
        whatever={name: _widest([own, *(e[name] for e in beside)]) for name, own in alone.items()},
    )


def inseparable(made: Diagnosed, seen: Account) -> tuple[Inseparable, ...]:
    """The rivals that the recording cannot tell from the cause looked at."""
    if seen.look is None:
        return ()
    return tuple(_pair(made.found, one) for one in seen.look.beside if one.inseparable)


def _pair(found: Found, one: Together) -> Inseparable:
    problem, (cause, rival) = found.problem, one.pair
    number = len(one.point.hypothesis.terms) - 1
    inside = estimates(problem, one.point, number - 1, one.draws, median=True)
    return Inseparable(
        between=(cause.key, rival.key),
        cause=_told(inside),
        rival=_told(estimates(problem, one.point, number, one.draws, median=True)),
        growth=one.growth,
        absent=not _proven(found, rival) and _may_be_absent(cause, inside),
        experiment=excite_command(problem.robot.name, cause.key, rival.key),
    )


def _told(own: dict[str, Estimate]) -> dict[str, EffectEstimate]:
    return {name: EffectEstimate(**vars(e)) for name, e in own.items()}


def _widest(every: list[Estimate]) -> EffectEstimate:
    """The first estimate with an interval that holds all of theirs."""
    ends = {"low": min(e.low for e in every), "high": max(e.high for e in every)}
    return EffectEstimate(**vars(every[0]) | ends)


def _proven(found: Found, rival: Term) -> bool:
    """Whether the cause has been named, and the rival alone explains the data less well: it is there."""
    if not found.accepted:
        return False
    return rival.key not in {s.point.hypothesis.terms[-1].key for s in found.rounds[0].equivalent}


def _may_be_absent(term: Term, told: dict[str, Estimate]) -> bool:
    """Whether every interval holds a size that is not worth naming (half the weak one)."""
    sized = [(told[p.name], p.inverse) for p in term.effect.parameters if not p.shape]
    return all(
        not inverse and e.low <= 0.5 * e.sizes[0] and e.high >= -0.5 * e.sizes[0] for e, inverse in sized
    )

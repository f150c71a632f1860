"""Intervals of the cause that a diagnosis examines most closely, and its rivals that the data do not exclude."""

from dataclasses import replace

from dynreg.diagnose.account import Account
from dynreg.diagnose.diagnose import Diagnosed
from dynreg.evidence.estimate import Estimate, estimates
from dynreg.evidence.hypothesis import WORTH
from dynreg.results.diagnosis import EffectEstimate, Inseparable, Looked
from dynreg.sim.effects import Term
from dynreg.verbs.diagnosis_words import excite_command


def looked(made: Diagnosed, seen: Account) -> Looked | None:
    """The first cause; without one the effect that was asked for, or the best ranked. None if nothing was ranked."""
    examined, model = seen.examined, made.found.model
    if examined is None:
        return None
    number = len(examined.point.hypothesis.terms) - 1
    alone = estimates(model, examined.point, number, examined.draws, median=True)
    beside = [estimates(model, one.point, number, one.draws, median=True) for one in examined.beside]
    widest = {}
    for name, own in alone.items():
        every = [own, *(e[name] for e in beside)]
        widest[name] = replace(own, low=min(e.low for e in every), high=max(e.high for e in every))
    return Looked(
        effect=examined.cause.effect.id,
        joints=examined.cause.joints,
        bodies=examined.cause.bodies,
        rivals=tuple(one.pair[1].key for one in examined.beside),
        alone=_documents(alone),
        whatever=_documents(widest),
    )


def inseparable(made: Diagnosed, seen: Account, word: str) -> tuple[Inseparable, ...]:
    """The rivals that the recording does not separate from the examined cause. word : the robot's, in a command."""
    if seen.examined is None:
        return ()
    model, out = made.found.model, []
    first = made.found.rounds[0] if made.found.accepted else None
    for one in seen.examined.beside:
        if not one.inseparable:
            continue
        cause, rival = one.pair
        number = len(one.point.hypothesis.terms) - 1
        inside = estimates(model, one.point, number - 1, one.draws, median=True)
        # a named cause that explains the data better than the rival alone is there
        proven = first and rival.key not in {s.term.key for s in first.as_good}
        out.append(
            Inseparable(
                between=(cause.key, rival.key),
                cause=_documents(inside),
                rival=_documents(estimates(model, one.point, number, one.draws, median=True)),
                growth=one.growth,
                absent=not proven and _may_be_absent(cause, inside),
                experiment=excite_command(word, cause.key, rival.key),
            )
        )
    return tuple(out)


def _documents(own: dict[str, Estimate]) -> dict[str, EffectEstimate]:
    return {name: EffectEstimate(**vars(e)) for name, e in own.items()}


def _may_be_absent(term: Term, own: dict[str, Estimate]) -> bool:
    """Whether every interval contains a negligible size (half the weak one)."""
    sized = [(own[p.name], p.inverse) for p in term.effect.parameters if not p.shape]
    return all(
        not inverse and e.low <= WORTH * e.sizes[0] and e.high >= -WORTH * e.sizes[0] for e, inverse in sized
    )

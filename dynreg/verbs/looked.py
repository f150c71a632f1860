"""How large the cause may be that a diagnosis looked at most closely, and the rivals that it cannot be told from."""

from dataclasses import replace

from dynreg.diagnose.account import Account
from dynreg.diagnose.diagnose import Diagnosed
from dynreg.evidence.estimate import Estimate, estimates
from dynreg.results.diagnosis import EffectEstimate, Inseparable, Looked
from dynreg.sim.effects import Term
from dynreg.verbs.diagnosis_words import excite_command


def looked(made: Diagnosed, seen: Account) -> Looked | None:
    """The first cause, or without one that asked for, or the best ranked; None where nothing was ranked."""
    look, model = seen.look, made.found.model
    if look is None:
        return None
    number = len(look.point.hypothesis.terms) - 1
    alone = estimates(model, look.point, number, look.draws, median=True)
    beside = [estimates(model, one.point, number, one.draws, median=True) for one in look.beside]
    widest = {}
    for name, own in alone.items():
        every = [own, *(e[name] for e in beside)]
        widest[name] = replace(own, low=min(e.low for e in every), high=max(e.high for e in every))
    return Looked(
        effect=look.cause.effect.id,
        joints=look.cause.joints,
        rivals=tuple(one.pair[1].key for one in look.beside),
        alone=_told(alone),
        whatever=_told(widest),
    )


def inseparable(made: Diagnosed, seen: Account) -> tuple[Inseparable, ...]:
    """The rivals that the recording cannot tell from the cause looked at."""
    if seen.look is None:
        return ()
    model, out = made.found.model, []
    first = made.found.rounds[0] if made.found.accepted else None
    for one in seen.look.beside:
        if not one.inseparable:
            continue
        cause, rival = one.pair
        number = len(one.point.hypothesis.terms) - 1
        inside = estimates(model, one.point, number - 1, one.draws, median=True)
        # a named cause that explains the data better than the rival alone is there
        proven = first and rival.key not in {s.point.hypothesis.terms[-1].key for s in first.equivalent}
        out.append(
            Inseparable(
                between=(cause.key, rival.key),
                cause=_told(inside),
                rival=_told(estimates(model, one.point, number, one.draws, median=True)),
                growth=one.growth,
                absent=not proven and _may_be_absent(cause, inside),
                experiment=excite_command(model.robot.name, cause.key, rival.key),
            )
        )
    return tuple(out)


def _told(own: dict[str, Estimate]) -> dict[str, EffectEstimate]:
    return {name: EffectEstimate(**vars(e)) for name, e in own.items()}


def _may_be_absent(term: Term, told: dict[str, Estimate]) -> bool:
    """Whether every interval holds a size that is not worth naming (half the weak one)."""
    sized = [(told[p.name], p.inverse) for p in term.effect.parameters if not p.shape]
    return all(
        not inverse and e.low <= 0.5 * e.sizes[0] and e.high >= -0.5 * e.sizes[0] for e, inverse in sized
    )

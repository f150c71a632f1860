"""Single trials: the hidden effects of each robot, and its diagnosis compared with them."""

from collections.abc import Sequence

import numpy as np

from dynreg.diagnose.independent import require_truth
from dynreg.diagnose.threshold import Threshold
from dynreg.diagnose.trial import (
    Trial,
    Trials,
    Tried,
    attainable_share,
    covered,
    joint_right,
    right_names,
    size_error,
    tried,
)
from dynreg.diagnose.verdict import rivals
from dynreg.errors import UsageError
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import Hidden
from dynreg.results.trials import TrialResult, confident
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Term, term
from dynreg.sim.robot import Robot


def results_of(
    trials: Trials, todo: Sequence[Trial], needed: Threshold, *, share: bool = True, interval: bool = False
) -> list[TrialResult]:
    """Hide effects in robots, diagnose their logs in lockstep, and score the first cause of each.

    share : whether to compute the share of the attainable gain, which takes one more fit. interval : whether to check
    that the 90 % interval of a rightly named effect's size covers the true size.
    """
    return [_result(trials, one, share, interval) for one in tried(trials, todo, needed)]


def _result(trials: Trials, one: Tried, share: bool, interval: bool) -> TrialResult:
    result = _scored(trials.robot, one)
    if interval and result.parameter_error is not None:
        result = result.model_copy(update={"covered": covered(trials, one)})
    known = all(np.isfinite(values).all() for values in one.hidden.values)
    if not share or not one.hidden.terms or not known or not one.made.found.accepted:
        return result
    return result.model_copy(update={"share_of_attainable_gain": attainable_share(trials, one)})


def _scored(robot: Robot, one: Tried) -> TrialResult:
    """The diagnosis of a robot with hidden effects, compared with the truth."""
    hidden, found, first, verdict = one.hidden, one.made.found, one.first, one.made.verdict
    first_round = found.rounds[0] if first else None
    stated = {first.key, *(s.term.key for s in first_round.as_good)} if first else set()
    causes = tuple(t.key for t in found.current.hypothesis.terms)
    truths = right_names(robot, hidden)
    right, in_part = first is None, False
    if hidden.outside:
        right = not confident(verdict)
    elif hidden.anything:
        stated_first = first is not None and any(first.key in truth for truth in truths)
        named = stated_first and all(t & {*causes} for t in truths)
        right, in_part = named and confident(verdict), named and verdict == "partly_explained"
    same = first is not None and len(hidden.terms) == 1 and first.key == hidden.terms[0].key
    same = same and np.isfinite(hidden.values[0][0])
    return TrialResult(
        robot=robot.name,
        seed=hidden.seed,
        hidden=hidden.id,
        outside=hidden.outside,
        size=hidden.size if hidden.anything else None,
        joints=hidden.joints,
        bodies=hidden.bodies,
        hidden_values=_values(hidden),
        true_parameters=robot.space.as_dict(hidden.parameters),
        named=first.key if first else None,
        causes=causes,
        verdict=verdict,
        right=right,
        in_part=in_part,
        joint_right=joint_right(robot, hidden, first),
        false_alarm=not hidden.anything and first is not None,
        in_set=bool(stated & set().union(*truths)) if truths and first else None,
        size_of_set=1 + len(rivals(robot, first_round)) if first else 0,
        parameter_error=size_error(one) if same else None,
        seconds=one.seconds,
        core_seconds=one.core_seconds,
    )


def _values(hidden: Hidden) -> dict[str, float]:
    """{name: true value} of the hidden effects' parameters."""
    return {
        p.name if len(hidden.terms) == 1 else f"{t.key}.{p.name}": float(v)
        for t, row in zip(hidden.terms, hidden.values, strict=True)
        for p, v in zip(t.effect.parameters, row, strict=True)
    }


def jobs(robot: Robot, hide: str, effects: tuple[str, ...], size: str, count: int, seed: int) -> list[Trial]:
    """The hidden effects of every robot; the arguments are those of `TrialSettings`."""
    every = single_terms(robot)
    shared = [t for i, t in enumerate(every) if t.effect.id not in {one.effect.id for one in every[:i]}]
    seeds = [stream_seed(seed, "trial", i) % 2**31 for i in range(count)]
    if hide == "nothing":
        return [Trial((), None, s) for s in seeds]
    if hide == "every":
        return [Trial((t,), size, stream_seed(s, t.key) % 2**31) for t in shared for s in seeds]
    if hide == "drawn":
        draw = stream(seed, "hidden effects").integers(0, len(shared), count)
        return [Trial((shared[d],), size, s) for d, s in zip(draw, seeds, strict=True)]
    chosen = _chosen(robot, effects)
    return [Trial(chosen, size, s) for s in seeds]


def independent_jobs(
    robot: Robot, hide: str, causes: tuple[str, ...], size: str, count: int, seed: int, physics: str
) -> list[Trial]:
    """As `jobs`, for hidden robots by other code; one cause each. `physics` chooses among those that are drawn.

    Raises UsageError for a robot that no such code is of, and for causes that it cannot have.
    """
    from dynreg.truths.table import causes_of, sized

    require_truth(robot)
    able = causes_of(robot.name, physics)
    seeds = [stream_seed(seed, "trial", i) % 2**31 for i in range(count)]
    if hide == "nothing":
        return [Trial((), None, s) for s in seeds]
    if hide == "every":
        return [Trial((), size, stream_seed(s, c) % 2**31, cause=c) for c in able for s in seeds]
    if hide == "drawn":
        draw = stream(seed, "hidden causes").integers(0, len(able), count)
        return [Trial((), size, s, cause=able[d]) for d, s in zip(draw, seeds, strict=True)]
    if len(causes) > 1:
        raise UsageError(
            f"{' and '.join(causes)} in one independent robot",
            expected="one cause",
            do="hide one at a time, or leave `truth` at 'own'",
        )
    sized(robot.name, causes[0].partition("[")[0], size, seed)
    return [Trial((), size, s, cause=causes[0]) for s in seeds]


def _chosen(robot: Robot, keys: tuple[str, ...]) -> tuple[Term, ...]:
    """The terms with these keys. Raises UsageError if one of them cannot act on the robot."""
    chosen = tuple(term(key) for key in keys)
    for t in chosen:
        wrong = t.effect.misplaced(robot, t.at)
        reason = t.effect.why_not(robot) or (wrong and wrong[0])
        if reason:
            raise UsageError(
                f"effect {t.key!r} on robot {robot.name!r}: {reason}",
                expected="an effect that can act on this robot",
                do=f"see `dynreg effects {robot.name}`",
            )
    return chosen

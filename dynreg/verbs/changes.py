"""What changed between two recordings: both are fitted by what a diagnosis of the recent one found."""

import time
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dynreg.diagnose.refit import refits
from dynreg.diagnose.refitted import Left, Refit, Refits, difference
from dynreg.errors import Assumed, CorruptError, NoMatchError, UsageError
from dynreg.evidence.lockstep import counted, run
from dynreg.progress import Progress
from dynreg.results.changes import AFTER, BEFORE, Change, Changes
from dynreg.results.changes import Left as LeftResult
from dynreg.results.result import Cost
from dynreg.verbs.diagnose import DiagnoseSettings, diagnose
from dynreg.verbs.refits import fields_of, interval_of
from dynreg.verbs.simulators import own, stored

if TYPE_CHECKING:
    from dynreg.results.diagnosis import Diagnosis
    from dynreg.sim.config import SimConfig
    from dynreg.verbs.subjects import Recorded


# Residuals of two recordings of an unchanged robot, in spreads of their motions, differ by less: see `EXPLAINED` in
# `diagnose/verdict.py`, and benchmarks/bench_changes.py.
MORE = 1.5


def changes(
    recent: "Recorded",
    earlier: "Recorded",
    settings: DiagnoseSettings,
    chosen: bool,
    progress: Progress | None,
) -> "tuple[Changes, tuple[tuple[Recorded, Diagnosis], ...]]":
    """The changes from the earlier recording to the recent one, and the diagnoses made for them.

    The recent recording is diagnosed from the simulator that a diagnosis of the earlier one found: the newest that is
    stored of this version of the robot and asked with the same options, or one that is made. What that finds is then
    fitted to each recording alone. Raises UsageError for one recording twice, and what `diagnose` does.
    """
    if recent.recording.id == earlier.recording.id:
        raise UsageError(
            f"{recent.name!r} against itself",
            expected="another recording, made before",
            do="name the earlier one with --against",
        )
    began, made = time.perf_counter(), ()
    taken = known(earlier, settings)
    if taken.diagnosis is None:
        first = diagnose(earlier, settings, progress)
        made = ((earlier, first),)
    else:
        first = taken.diagnosis
    start = _found(first)
    second = diagnose(recent, replace(settings, start=start), progress)
    answer = stored(recent.registry, "simulator", _found(second), recent.robot).config
    both, rollouts = _refits(recent, earlier, settings, answer, second.threshold_nats, progress)
    cost = Cost(
        evaluations=0,
        rollouts=rollouts + second.cost.rollouts + sum(one.cost.rollouts for _, one in made),
        test_rollouts=second.cost.test_rollouts,
        seconds=time.perf_counter() - began,
    )
    found = _document(recent, earlier, (first, second), both, chosen, settings.seed, cost)
    found = found.model_copy(update={"taken": taken.identity, "notes": (taken.said, *found.notes)})
    return found, (*made, (recent, second))


@dataclass(frozen=True)
class Taken:
    """A stored diagnosis of the earlier recording that fits, and its id; None where none does. said : which, or why."""

    diagnosis: "Diagnosis | None"
    identity: str | None
    said: str


def known(earlier: "Recorded", settings: DiagnoseSettings) -> Taken:
    """The newest stored diagnosis of a recording that fits.

    It left a simulator of this version of the robot, and was asked with the same options. Where there are others alone,
    that a new one is made is said at once (`Assumed`), with what to type to take the newest.
    """
    from dynreg.results.diagnosis import Diagnosis

    registry, name = earlier.registry, earlier.name
    identities = (
        registry.results_about("diagnosis", earlier.recording.id)
        if registry.holds(earlier.recording.id)
        else ()
    )
    reasons: list[str] = []
    for identity in identities:
        try:
            found = Diagnosis.model_validate(registry.result(identity).document)
        except CorruptError:
            reasons.append("is damaged: see `dynreg verify`")
            continue
        reason = _unfit(found, earlier, settings)
        if reason is None:
            older = f", the newest of {len(identities)}" if len(identities) > 1 else ""
            return Taken(found, identity, f"diagnosis {identity[:12]} of {name} was taken{older}")
        reasons.append(reason)
    if not reasons:
        return Taken(None, None, f"no diagnosis of {name} was stored: one was made")
    many = "the stored diagnosis" if len(reasons) == 1 else f"none of the {len(reasons)} stored diagnoses"
    text = f"{many} of {name} {'does not fit' if len(reasons) == 1 else 'fits'} (the newest {reasons[0]})"
    warnings.warn(f"{text}: a new one is made", Assumed, 2)
    return Taken(None, None, f"{text}: a new one was made")


def _unfit(found: "Diagnosis", earlier: "Recorded", settings: DiagnoseSettings) -> str | None:
    """Why a stored diagnosis does not fit; None where it does."""
    from dynreg.verbs.diagnosis import options_told

    identity = found.extended_simulator or found.calibrated_simulator
    if identity is None:
        return "left no simulator"
    try:
        own(stored(earlier.registry, "simulator", identity, earlier.robot), earlier.robot)
    except (NoMatchError, UsageError):
        return f"is of another version of robot {found.robot!r}"
    if found.asked is None:
        return "does not tell its options: an older dynreg stored it"
    wanted = options_told(settings.options)
    other = {name: value for name, value in found.asked.items() if wanted.get(name) != value}
    if not other:
        return None
    flags = [word for name, value in other.items() if (word := _flag(name, value))]
    told = f"; to take it, add {' '.join(flags)}" if len(flags) == len(other) else ""
    return f"was asked with other options: {', '.join(f'{n} {_said(v)}' for n, v in other.items())}{told}"


def _said(value: object) -> str:
    return "usual" if value is None else ",".join(value) if isinstance(value, list) else f"{value}"


def _flag(name: str, value: object) -> str:
    """How an option is given to `drift`; "" where it cannot be."""
    if name not in ("effects", "threshold_runs", "tolerance", "horizon", "windows") or value is None:
        return ""
    return f"--{name.replace('_', '-')} {_said(value)}"


def _found(of: "Diagnosis") -> str:
    """The id of the simulator that a diagnosis found."""
    identity = of.extended_simulator or of.calibrated_simulator
    if identity is None:
        raise NoMatchError(
            "the diagnosis left no simulator", expected="one", do="run `dynreg diagnose` again"
        )
    return identity


def _refits(
    recent: "Recorded",
    earlier: "Recorded",
    settings: DiagnoseSettings,
    answer: "SimConfig",
    limit: float,
    progress: Progress | None,
) -> tuple[Refits, int]:
    report = progress or (lambda *_: None)
    report("both recordings", 0, 1)
    both = {BEFORE: earlier.recording, AFTER: recent.recording}
    search = refits(recent.robot, both, settings.options, answer, limit)
    found = run(counted(search), threads=settings.threads)
    report("both recordings", 1, 1)
    return found


def verdict_of(both: Refits, second: "Diagnosis") -> str:
    """Whether values "changed", the earlier diagnosis is "still true", or neither says the recent recording.

    "unexplained": no value differs, and the recent recording shows an error that no effect explains, or one that is
    more than `MORE` times that of the earlier recording, each in units of its own motion.
    """
    if any(not one.same for one in both.each):
        return "changed"
    before, after = both.left[BEFORE], both.left[AFTER]
    more = after.residual > MORE * max(before.residual, after.noise)
    return "unexplained" if more or second.verdict == "unknown" else "still true"


def _document(
    recent: "Recorded",
    earlier: "Recorded",
    diagnoses: "tuple[Diagnosis, Diagnosis]",
    both: Refits,
    chosen: bool,
    seed: int,
    cost: Cost,
) -> Changes:
    first, second = diagnoses
    order = sorted(both.each, key=lambda one: (one.same, -one.nats))
    return Changes(
        robot=recent.robot.name,
        recording=recent.recording.id,
        recording_name=recent.name,
        earlier=earlier.recording.id,
        earlier_name=earlier.name,
        chosen=chosen,
        verdict=verdict_of(both, second),
        left={name: _left(one) for name, one in both.left.items()},
        gain=second.over_start,
        changes=tuple(_change(one) for one in order),
        threshold_nats=second.threshold_nats,
        began=_found(first),
        answer=_found(second),
        error=second.error,
        traces=second.traces,
        notes=_notes(second, both),
        seed=seed,
        cost=cost,
    )


def _change(one: Refit) -> Change:
    apart = difference(one, BEFORE, AFTER)
    return Change(**fields_of(one), difference=interval_of(apart, one.unit))


def _left(one: Left) -> LeftResult:
    return LeftResult(residual=one.residual, noise=one.noise)


def _notes(second: "Diagnosis", both: Refits) -> tuple[str, ...]:
    out = []
    for cause in second.causes:
        if all(one.same for one in both.each if one.cause == cause.key):
            out.append(
                f"only the recent recording's diagnosis names {cause.key}. Fitted to both recordings, its size does"
                " not differ: it is no change"
            )
    if second.verdict == "unknown":
        out.append("the recent recording has an error that no effect of the library explains")
    elif second.verdict == "partly_explained":
        out.append("part of the error of the recent recording stays unexplained")
    return tuple(out)

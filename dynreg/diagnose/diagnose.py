"""Diagnose: name the physical causes of a simulator's error.

The steps: pose the problem, calibrate, find the threshold, accept one cause after the other while its evidence exceeds
the threshold (screen, refit, score), settle, hold the residual against its noise floor, and judge on the test part.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from dynreg.data.recording import Recording
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.doubts import Doubt, doubts
from dynreg.diagnose.guided import guided
from dynreg.diagnose.joints import terms_at
from dynreg.diagnose.judging import Judged, judge, unpenalised
from dynreg.diagnose.measured import measured_effects
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.ranking.population import Ranking
from dynreg.diagnose.score import passing
from dynreg.diagnose.settle import revise, unlike
from dynreg.diagnose.threshold import Cache, Nulls, Threshold, found_before, threshold
from dynreg.diagnose.verdict import Evidence, Verdict, verdict_of
from dynreg.diagnose.zeros import shifted, zeroed
from dynreg.errors import UsageError
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import Search, counted, together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.progress import Progress
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Term, applicable
from dynreg.sim.effects import effect as effect_of
from dynreg.sim.robot import Robot

LONGER = "still searching"  # the stage after as many simulations as were expected


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """The result of a search for causes. problem : as posed. found : the final state of the search.

    ranking : what the log looks like, where the search had a guide.
    """

    problem: Problem
    found: State
    threshold: Threshold
    evidence: Evidence
    judged: Judged
    doubts: tuple[Doubt, ...]
    verdict: Verdict
    ranking: Ranking | None = None


def diagnose(
    robot: Robot,
    recording: Recording,
    options: DiagnosisOptions,
    start: SimConfig | None = None,
    *,
    cache: Cache | None = None,
    progress: Progress | None = None,
    nulls: Nulls | None = None,
) -> Search[Diagnosed]:
    """Name the effects that a simulator of `robot` lacks to explain the recording.

    start : the simulator, by default the nominal one. cache : of thresholds, and of simulators with one effect each.
    nulls : see `threshold`.
    Fit, select and test parts have no trajectory in common. The search does not read the test part; the verdict does,
    once: causes that raise the error there are not called named.
    Raises the errors of `pose` and `offered`.
    """
    problem = yield from posed(robot, recording, options, start, cache, progress)
    limit = threshold(problem, recording, options, cache, progress, nulls)
    elsewhere = nulls is not None or found_before(problem, recording, options, cache)
    runs = 0 if elsewhere else options.threshold_runs
    total = problem.plan.expected(len(problem.model.coordinates), len(problem.terms), runs)
    found, many = yield from counted(
        search(problem, recording, limit, options, progress), simulated(progress, total)
    )
    report = progress or (lambda *_: None)
    report("simulations", total, total)  # fewer may have done
    if many >= total:
        report(LONGER, 1, 1)
    return found


def posed(
    robot: Robot,
    recording: Recording,
    options: DiagnosisOptions,
    start: SimConfig | None = None,
    cache: Cache | None = None,
    progress: Progress | None = None,
) -> Search[Problem]:
    """A recording as a problem, with its plan, its terms and its guide; the arguments are those of `diagnose`."""
    model, data = pose(robot, recording, options, start)
    problem = yield from planned(model, data, offered(model, data, options))
    return (yield from guided(problem, recording, options, cache, progress))


def simulated(progress: Progress | None, total: int) -> Callable[[int], None]:
    """What tells how many of about `total` simulations are done; of more than that, that the search goes on.

    How many more there will be nobody knows: the estimate is good to a factor of two.
    """
    report = progress or (lambda *_: None)

    def told(done: int) -> None:
        report("simulations", min(done, total), total)
        if done >= total:
            report(LONGER, 0, 1)

    return told


def search(
    problem: Problem,
    recording: Recording,
    limit: Search[Threshold],
    options: DiagnosisOptions,
    progress: Progress | None = None,
) -> Search[Diagnosed]:
    """Calibrate, find the threshold, add causes while they exceed it, and refit on the fit and select parts."""
    report = progress or (lambda *_: None)
    plan, posed = problem.plan, problem.data
    report("calibrate", 0, 1)
    calibrating = calibrate(problem.model, posed, draws=plan.draws, seed=options.seed)
    found, least = yield from together([calibrating, limit])
    report("calibrate", 1, 1)
    state = State(found.model, found.sample, found.point, found.point)
    ranking: Ranking | None = None
    report("causes", 0, 1)  # their number is a limit: of how many there are it tells nothing
    for number in range(options.max_causes):
        left = unlike(state.model.robot, problem.terms, state.current.hypothesis.terms)
        if not left:
            break
        hints: list[Point] = []
        if problem.guide is not None:
            own = yield from looks(problem, state, left)
            ranking = ranking or own
            hints = problem.guide.hints(own, state.model, state.current, left)
        naming, model = yield from plan.name(state.model, state.current, left, state.sample, hints)
        naming = replace(passing(naming, least.nats), needed=least.nats)
        state = replace(state, model=model, rounds=(*state.rounds, naming))
        if number == 0:
            state = replace(state, base=naming.start.point)
        if naming.chosen is None or naming.chosen.nats < least.nats:
            break
        state = yield from accepted(state, posed)
    report("causes", 1, 1)
    state = yield from plan.settle(state, posed, options.seed)
    evidence = yield from left_over(state, posed, problem.train_part(recording), least.ratios)
    loose = yield from unpenalised(state, posed)
    judged = yield from judge(problem.model, state, loose, posed)
    doubted = doubts(state, judged, ranking)
    verdict = verdict_of(state.model.robot, evidence, state.rounds, state.accepted, doubted)
    return Diagnosed(problem, state, least, evidence, judged, doubted, verdict, ranking)


def left_over(
    state: State, posed: Data, recording: Recording, usual: Sequence[float] = ()
) -> Search[Evidence]:
    """What the search leaves beside its noise floor; without a cause, where the zeros of episodes do not explain it.

    posed : the recording with its logged zeros. The other arguments are those of `Evidence.of`.
    """
    evidence = yield from Evidence.of(state, recording, usual)
    if state.accepted or evidence.explained:
        return evidence
    free = yield from zeroed(state, posed)
    if free is state:
        return evidence
    evidence = yield from Evidence.of(free, recording, usual)
    moved = shifted(free.model.robot, posed.windows, free.data.windows) if evidence.explained else {}
    return replace(evidence, zeros=moved)


def looks(problem: Problem, state: State, left: Sequence[Term]) -> Search[Ranking]:
    """What the log looks like, among the terms that are left; after the first cause, what the causes so far leave."""
    if state.accepted:
        return (yield from problem.guide.left(state.model, state.current, state.data, left))
    return (yield from problem.guide.ranking(problem.model, state.data, left))


def accepted(state: State, posed: Data) -> Search[State]:
    """The state with the last round's cause accepted: earlier causes may change, and episodes get their zeros."""
    rounds = yield from revise(state.model, state.rounds, state.sample)
    current = rounds[-1].chosen.point
    state = replace(state, rounds=tuple(rounds), current=current, accepted=state.accepted + 1)
    return (yield from zeroed(state, posed))


def offered(model: Model, data: Data, options: DiagnosisOptions) -> list[Term]:
    """The candidate terms: at the chosen joints, without the effects that a measured input already contains.

    Raises UsageError if none of the requested effects can act.
    """
    robot, held = model.robot, measured_effects(model.robot, data.train)
    terms = single_terms(robot, options.effects or (), (*options.without, *held))
    if some_joints(robot, options):
        terms = terms_at(terms, options.joints)
    if terms:
        return terms
    measured = [f"the measured input {by} already contains {name}" for name, by in held.items()]
    why = [f"{name!r}: {why}" for name, why in no_candidates(robot, data, options, ()).items()]
    raise UsageError(
        "; ".join(["no effect is left to look for", *why, *measured]),
        expected=f"an effect that can act on {', '.join(options.joints or ()) or f'robot {robot.name!r}'}",
        do=f"leave out the choice of {'joints' if options.joints else 'effects'}, or see `dynreg effects {robot.name}`",
    )


def no_candidates(
    robot: Robot, data: Data, options: DiagnosisOptions, terms: Sequence[Term]
) -> dict[str, str]:
    """{effect id: why} of the effects that were asked for and have no place among the candidate `terms`.

    Where none was asked for, those that a choice of joints leaves out. Not those that a measured input contains: see
    `measured_effects`.
    """
    able, held = applicable(robot), measured_effects(robot, data.train)
    some = some_joints(robot, options)
    asked = [name for name in able if some and name not in options.without]
    found, out = {term.effect.id for term in terms}, {}
    for name in asked if options.effects is None else options.effects:
        if name in found or name in held:
            continue
        if name not in able:
            out[name] = f"robot {robot.name!r} cannot have it ({effect_of(name).why_not(robot)})"
        elif able[name].scope != "joint":
            out[name] = "an effect of the whole robot needs all its joints; leave out the choice of joints"
        else:
            out[name] = "it is an effect of all joints together; leave out the choice of joints"
    return out


def some_joints(robot: Robot, options: DiagnosisOptions) -> bool:
    """Whether a diagnosis is of a part of the driven joints."""
    return bool(options.joints) and {*options.joints} != {*robot.driven}

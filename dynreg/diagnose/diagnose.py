"""Diagnose: what a simulator gets wrong, and the causes by name.

Pose the problem, calibrate, find the threshold, add one cause after the other while they pass it, refit, and judge
what is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.effort import FULL, Effort
from dynreg.diagnose.evidence import Evidence, Verdict, verdict_of
from dynreg.diagnose.fit import fit, polish
from dynreg.diagnose.hypothesis import single_terms
from dynreg.diagnose.joints import terms_at
from dynreg.diagnose.name import name_one
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.score import Naming
from dynreg.diagnose.settle import revise, settle, unlike
from dynreg.diagnose.shown import shown
from dynreg.diagnose.threshold import Cache, Threshold, threshold
from dynreg.diagnose.zeros import rezeroed
from dynreg.errors import UsageError
from dynreg.replay.parts import Parts
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Term
from dynreg.sim.robot import Robot

ZEROED = 2  # times that the zeros of episodes and the simulator are fitted in turn after each cause
ENDED = 2  # iterations of the last refit where rollouts are rough: each simulates the finer time step
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Found:
    """What a search for causes came to: points of the calibrated and the extended simulator, round by round.

    problem : the one that `extended` was fitted in, with its zeros of the episodes.
    """

    base: Point
    extended: Point
    rounds: tuple[Naming, ...]
    accepted: int
    threshold: Threshold
    problem: Problem


@dataclass(frozen=True)
class Diagnosed:
    """A search with what it was made on and how it is judged. problem : as posed; split : its windows' parts."""

    problem: Problem
    split: Parts
    found: Found
    evidence: Evidence
    verdict: Verdict

    @property
    def judged(self) -> np.ndarray:
        """(K,) windows by which the simulators are judged: those of the test part, where something was held out."""
        return np.flatnonzero(self.split.test) if self.tested else np.flatnonzero(self.split.select)

    @property
    def tested(self) -> bool:
        """Whether anything was held out."""
        return bool(self.split.test.any())


def diagnose(
    robot: Robot,
    recording: Recording,
    options: DiagnosisOptions,
    start: SimConfig | None = None,
    *,
    cache: Cache | None = None,
    progress: Progress | None = None,
) -> Diagnosed:
    """Name what a simulator of `robot` lacks to move as the recording says: `start`, by default the nominal one.

    Fit, select and test are disjoint by trajectory; nothing reads test here. cache : keeps thresholds.
    Raises as `pose` and `offered`.
    """
    problem, split = pose(robot, recording, options, start)
    found = search(problem, offered(problem, options), split, options, cache=cache, progress=progress)
    evidence = Evidence.of(found.problem, recording, found.extended, split.chosen)
    verdict = verdict_of(problem.robot, evidence, found.rounds, found.accepted)
    return Diagnosed(problem, split, found, evidence, verdict)


def offered(problem: Problem, options: DiagnosisOptions) -> list[Term]:
    """The terms that may be named: at the joints that are looked at, and in no measured input.

    Raises UsageError where none of the effects asked for can act.
    """
    robot, held = problem.robot, shown(problem.robot, problem.windows)
    terms = single_terms(robot, options.effects or (), (*options.without, *held))
    if options.joints:
        terms = terms_at(terms, options.joints)
    if terms:
        return terms
    if options.joints:
        raise UsageError(
            f"none of the effects asked for acts on single joints such as {options.joints[0]!r}",
            expected="effects of joints",
            do="leave the choice of joints out",
        )
    measured = "".join(f"; {name} is in the {by} that was measured" for name, by in held.items())
    raise UsageError(
        f"none of the effects {list(options.effects or ())} can act on robot {robot.name!r}{measured}",
        expected="an effect that can",
        do=f"see `dynreg effects {robot.name}`",
    )


def search(
    problem: Problem,
    terms: list[Term],
    split: Parts,
    options: DiagnosisOptions,
    *,
    needed: float | None = None,
    cache: Cache | None = None,
    effort: Effort = FULL,
    progress: Progress | None = None,
) -> Found:
    """Calibrate, find the threshold, add one cause after the other while they pass it, refit on fit and select.

    needed : the threshold [nats], where it is known.
    """
    report = progress or (lambda *_: None)
    fit_on, select_on = np.flatnonzero(split.fit), np.flatnonzero(split.select)
    report("calibrate", 0, 1)
    many = len(terms) > effort.long
    base, effective = calibrate(problem, fit_on, draws=0 if many else effort.draws, seed=options.seed)
    report("calibrate", 1, 1)
    if needed is None:
        of = {"runs": options.threshold_runs, "seed": options.seed, "effort": effort}
        limit = threshold(cache, problem, terms, split, **of, progress=progress)
    else:
        limit = Threshold(needed, ())
    begun = Found(base, base, (), 0, limit, problem)
    found = _rounds(problem, begun, terms, (fit_on, select_on), effective, options.max_causes, effort, report)
    return _refitted(problem, found, (fit_on, select_on), effective, many, options.seed)


def _rounds(
    problem: Problem,
    found: Found,
    terms: list[Term],
    parts: tuple[np.ndarray, np.ndarray],
    effective: np.ndarray,
    most: int,
    effort: Effort,
    report: Progress,
) -> Found:
    """One cause after the other, while they pass the threshold; `most` at the most.

    effective : (W, C) independent samples of the fit windows.
    """
    rounds: list[Naming] = []
    accepted, base, current, zeroed = 0, found.base, found.base, problem
    for number in range(most):
        report("causes", number, most)
        left = unlike(problem.robot, terms, current.hypothesis.terms)
        if not left:
            break
        naming = name_one(zeroed, current, left, *parts, effective, effort=effort)
        rounds.append(naming)
        if number == 0:
            base = naming.start.point
        if naming.chosen is None or naming.chosen.nats < found.threshold.nats:
            break
        accepted += 1
        rounds = revise(zeroed, rounds, *parts, effective)
        zeroed, current = _zeroed(problem, zeroed, rounds[-1].chosen.point, *parts)
    report("causes", most, most)
    return Found(base, current, tuple(rounds), accepted, found.threshold, zeroed)


def _refitted(
    problem: Problem,
    found: Found,
    parts: tuple[np.ndarray, np.ndarray],
    effective: np.ndarray,
    many: bool,
    seed: int,
) -> Found:
    """The calibrated and the extended simulator fitted on fit and select together."""
    both, zeroed = np.concatenate(parts), found.problem
    base, current, rounds = found.base, found.extended, found.rounds
    pooled = np.concatenate(
        [effective, np.tile(effective.mean(axis=0), (len(parts[1]) * problem.segments, 1))]
    )
    if many and problem.stands:
        # fitted on all windows already; a last round that found no more has gone on with `current`
        current = current if len(rounds) == found.accepted else rounds[-1].start.point
        zeroed.refine([current], both)
        return replace(found, extended=current)
    if many and problem.rough:
        base, current = _ended(problem, zeroed, base, current if found.accepted else None, both)
        return replace(found, base=base, extended=current)
    (base,), _ = fit(problem, [base], both, pooled, iterations=1 if many else 4)
    if not found.accepted:
        current = base
    elif many:
        for _ in range(2):
            zeroed.refine([current], both)
            own = zeroed.effective(zeroed.residuals([current], both)[0])
            (current,), _ = fit(zeroed, [current], both, own, iterations=2)
    else:
        current = settle(zeroed, current, both, pooled, seed=seed)
    return replace(found, base=base, extended=current)


def _zeroed(
    problem: Problem, zeroed: Problem, point: Point, fit_on: np.ndarray, select_on: np.ndarray
) -> tuple[Problem, Point]:
    """The point refitted in turn with the zeros of the episodes, and the problem whose windows have these.

    zeroed : the same problem with the zeros of an earlier point.
    """
    for _ in range(ZEROED):
        cut = rezeroed(zeroed, problem.windows, point, np.concatenate([fit_on, select_on]))
        if cut is problem.windows:  # nothing is set to zero anew
            break
        zeroed = replace(zeroed, windows=cut)
        zeroed.refine([point], np.arange(len(cut)))
        effective = zeroed.effective(zeroed.residuals([point], fit_on)[0])
        (point,), _ = fit(zeroed, [point], fit_on, effective, iterations=3)
    return zeroed, point


def _ended(
    problem: Problem, zeroed: Problem, base: Point, extended: Point | None, chosen: np.ndarray
) -> tuple[Point, Point]:
    """The calibrated and the extended model refitted where rollouts are rough; the same one where no cause is named.

    The finer time step is simulated at every point: what it changes is not the same from one to the next, and the
    causes must not gain by it. Together they take less time: most of a fine rollout goes to the steps, not the rows.
    """
    if extended is None:
        (base,), _ = polish(problem, [base], chosen, iterations=ENDED)
        extended = base
    elif zeroed is problem:
        (base, extended), _ = polish(problem, [base, extended], chosen, iterations=ENDED)
    else:
        (base,), _ = polish(problem, [base], chosen, iterations=ENDED)
        (extended,), _ = polish(zeroed, [extended], chosen, iterations=ENDED)
    zeroed.refine([extended], chosen)
    return base, extended

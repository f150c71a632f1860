"""Diagnose: what a simulator gets wrong, and the causes by name.

One page: pose the problem, calibrate, find the threshold, name one cause after the other while they pass it (screen,
refit, score, accept), settle, and tell what is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.joints import terms_at
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.settle import revise, unlike
from dynreg.diagnose.shown import shown
from dynreg.diagnose.threshold import Cache, Threshold, threshold
from dynreg.diagnose.verdict import Evidence, Verdict, verdict_of
from dynreg.diagnose.zeros import zeroed
from dynreg.errors import UsageError
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.model import Model
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Term
from dynreg.sim.robot import Robot

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """What a search for causes came to, and how it is judged. problem : as posed; found : where the search ended."""

    problem: Problem
    found: State
    threshold: Threshold
    evidence: Evidence
    verdict: Verdict

    @property
    def judged(self) -> np.ndarray:
        """(K,) windows by which the simulators are judged: those of the test part, where something was held out."""
        parts = self.problem.data.parts
        return np.flatnonzero(parts.test if self.tested else parts.select)

    @property
    def tested(self) -> bool:
        """Whether anything was held out."""
        return bool(self.problem.data.parts.test.any())


def diagnose(
    robot: Robot,
    recording: Recording,
    options: DiagnosisOptions,
    start: SimConfig | None = None,
    *,
    cache: Cache | None = None,
    progress: Progress | None = None,
) -> Search[Diagnosed]:
    """Name what a simulator of `robot` lacks to move as the recording says: `start`, by default the nominal one.

    Fit, select and test are disjoint by trajectory; nothing reads test here. cache : keeps thresholds.
    Raises as `pose` and `offered`.
    """
    model, data = pose(robot, recording, options, start)
    problem = yield from planned(model, data, offered(model, data, options))
    limit = threshold(problem, recording, options, cache, progress)
    return (yield from search(problem, recording, limit, options, progress))


def search(
    problem: Problem,
    recording: Recording,
    limit: Search[Threshold],
    options: DiagnosisOptions,
    progress: Progress | None = None,
) -> Search[Diagnosed]:
    """Calibrate, find the threshold, add one cause after the other while they pass it, refit on fit and select."""
    report = progress or (lambda *_: None)
    plan, posed = problem.plan, problem.data
    report("calibrate", 0, 1)
    calibrating = calibrate(problem.model, posed, draws=plan.draws, seed=options.seed)
    found, least = yield from together([calibrating, limit])
    report("calibrate", 1, 1)
    state = State(found.model, found.sample, found.point, found.point)
    for number in range(options.max_causes):
        report("causes", number, options.max_causes)
        left = unlike(state.model.robot, problem.terms, state.current.hypothesis.terms)
        if not left:
            break
        naming, model = yield from plan.name(state.model, state.current, left, state.sample)
        state = replace(state, model=model, rounds=(*state.rounds, naming))
        if number == 0:
            state = replace(state, base=naming.start.point)
        if naming.chosen is None or naming.chosen.nats < least.nats:
            break
        state = yield from accepted(state, posed)
    report("causes", options.max_causes, options.max_causes)
    state = yield from plan.settle(state, posed, options.seed)
    evidence = yield from Evidence.of(state, recording)
    verdict = verdict_of(state.model.robot, evidence, state.rounds, state.accepted)
    return Diagnosed(problem, state, least, evidence, verdict)


def accepted(state: State, posed: Data) -> Search[State]:
    """The search with the last round's cause accepted: earlier ones are chosen again, episodes get their zeros."""
    rounds = yield from revise(state.model, state.rounds, state.sample)
    current = rounds[-1].chosen.point
    state = replace(state, rounds=tuple(rounds), current=current, accepted=state.accepted + 1)
    return (yield from zeroed(state, posed))


def offered(model: Model, data: Data, options: DiagnosisOptions) -> list[Term]:
    """The terms that may be named: at the joints that are looked at, and in no measured input.

    Raises UsageError where none of the effects asked for can act.
    """
    robot, held = model.robot, shown(model.robot, data.windows)
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

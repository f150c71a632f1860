"""Trials: hide an effect in a simulated robot, diagnose its log blind, and hold the answer against the truth."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.diagnose import Found, search
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.evidence import Evidence, Verdict, verdict_of
from dynreg.diagnose.fit import fit
from dynreg.diagnose.hypothesis import Hypothesis, single_terms
from dynreg.diagnose.interval import posterior
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.threshold import USUAL, Cache, null_score, null_seed, threshold
from dynreg.diagnose.truth import Hidden, Protocol, hide, log_of
from dynreg.replay.parts import Parts
from dynreg.rng import stream_seed
from dynreg.sim.effects import Term, one_group
from dynreg.sim.robot import Robot

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Trials:
    """Hidden robots under one protocol, so that one threshold serves them all, and how their logs are diagnosed.

    engine : of the diagnosis; by default the robot's first. threshold_runs, threads : as in `DiagnosisOptions`.
    seed : of the robots without an effect that tell the threshold.
    """

    robot: Robot
    plan: Protocol
    engine: str | None = None
    threshold_runs: int = DiagnosisOptions.threshold_runs
    threads: int = 0
    seed: int = 0

    @property
    def truth_engine(self) -> str:
        """Another engine than the diagnosis runs on, where the robot has one."""
        mine = self.robot.running(self.engine)
        others = [e for e in self.robot.engines if e != mine]
        return others[0] if others else mine

    def options(self, without: tuple[str, ...] = (), max_causes: int = 1) -> DiagnosisOptions:
        """Those of a diagnosis that knows nothing of the truth."""
        return DiagnosisOptions(
            hold_out=",".join(n for n in self.plan.names if n.startswith("test")),
            without=without,
            max_causes=max_causes,
            engine=self.engine,
            threshold_runs=self.threshold_runs,
            threads=self.threads,
        )


@dataclass(frozen=True)
class Tried:
    """One hidden robot, and what a diagnosis said of it. seconds, core_seconds : that it took, those of all cores."""

    hidden: Hidden
    problem: Problem
    split: Parts
    found: Found
    verdict: Verdict
    seconds: float
    core_seconds: float

    @property
    def first(self) -> Term | None:
        """The first cause that was stated."""
        found = self.found
        return found.rounds[0].chosen.point.hypothesis.terms[-1] if found.accepted else None


def trial_threshold(trials: Trials, cache: Cache | None = None, progress: Progress | None = None) -> float:
    """[nats] that a cause needs under the protocol's commands."""
    if trials.threshold_runs == 0:
        return USUAL
    posed, seed = _without_effect(trials)
    return threshold(cache, *posed, runs=trials.threshold_runs, seed=seed, progress=progress).nats


def null_scores(trials: Trials, numbers: Iterable[int]) -> list[float]:
    """[nats] of the robots without an effect of these numbers, which `trial_threshold` finds its threshold by."""
    posed, seed = _without_effect(trials)
    return [null_score(*posed, null_seed(seed, i)) for i in numbers]


def _without_effect(trials: Trials) -> tuple[tuple[Problem, list[Term], Parts], int]:
    """(problem, terms, parts of the windows) of a robot without an effect under the plan, and its seed."""
    robot, seed = trials.robot, stream_seed(trials.seed, "threshold") % 2**31
    recording = log_of(robot, hide(robot, (), None, seed), trials.plan, engine=trials.truth_engine)
    problem, split = pose(robot, recording, trials.options())
    return (problem, single_terms(robot), split), seed


def tried(
    trials: Trials,
    terms: tuple[Term, ...],
    size: str | None,
    seed: int,
    needed: float,
    *,
    without: tuple[str, ...] = (),
    max_causes: int = 1,
) -> Tried:
    """Hide `terms` at `size` in the robot of `seed` and diagnose its log; a cause needs `needed` nats."""
    robot = trials.robot
    hidden = hide(robot, terms, size, seed)
    recording = log_of(robot, hidden, trials.plan, engine=trials.truth_engine)
    began, busy = time.perf_counter(), time.process_time()
    options = trials.options(without, max_causes)
    problem, split = pose(robot, recording, options)
    found = search(problem, single_terms(robot, (), without), split, options, needed=needed)
    evidence = Evidence.of(found.problem, recording, found.extended, split.chosen)
    verdict = verdict_of(robot, evidence, found.rounds, found.accepted)
    spent = time.perf_counter() - began, time.process_time() - busy
    return Tried(hidden, problem, split, found, verdict, *spent)


def same_cause(robot: Robot, hidden: Term) -> set[str]:
    """Keys that name the same cause: the term's, and those of its exact group about the same joints."""
    return {hidden.key, *(t.key for t in single_terms(robot) if one_group(robot, hidden, t))}


def joint_right(robot: Robot, hidden: Hidden, first: Term | None) -> bool | None:
    """Whether the cause sits in the joints where one is hidden; None where it does not sit in a joint.

    An effect of the whole robot that no commands tell from the hidden one sits there, too.
    """
    joints = tuple(j for t in hidden.terms for j in t.joints)
    if not joints:
        return None
    return first is not None and (
        first.joints == joints or any(first.key in same_cause(robot, t) for t in hidden.terms)
    )


def attainable_share(problem: Problem, split: Parts, hidden: Hidden, found: Found) -> float | None:
    """(calibrated - extended) / (calibrated - true structure refitted) on test; None where nothing can be won."""
    if not split.test.any():
        return None
    c = problem.coordinates
    effect = np.concatenate(
        [c.effect_coordinates(t, v) for t, v in zip(hidden.terms, hidden.values, strict=True)]
    )
    true = Point(Hypothesis(hidden.terms), c.from_values(hidden.parameters), effect)
    _, effective = calibrate(problem, split.chosen[:2], iterations=1)
    pooled = np.tile(effective.mean(axis=0), (len(split.chosen) * problem.segments, 1))
    (refitted,), _ = fit(problem, [true], split.chosen, pooled, iterations=2)
    test = np.flatnonzero(split.test)
    base, extended, best = (
        problem.window_errors(s, test).mean()
        for s in problem.states([found.base, found.extended, refitted], test)
    )
    return float((base - extended) / (base - best)) if base - best > 0.02 * base else None


def covered(one: Tried) -> bool:
    """Whether the 90 % interval of the effect's size holds the hidden one, in the zeros that it was fitted with."""
    problem, point = one.found.problem, one.found.extended
    draws = posterior(problem, point, one.split.chosen)
    size = next(iter(estimates(problem, point, 0, draws).values()))
    return bool(size.low <= one.hidden.values[0][0] <= size.high)


def size_error(one: Tried) -> float:
    """Relative error of the effect's size."""
    point, true = one.found.extended, one.hidden.values[0][0]
    size = one.problem.coordinates.effect_values(point.hypothesis, point.effect[None])[0][0][0]
    return float(abs(size - true) / abs(true))

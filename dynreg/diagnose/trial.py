"""Trials: hide an effect in a simulated robot, diagnose its log blind, and score the answer."""

import time
from collections.abc import Callable, Iterable

import numpy as np

from dynreg.diagnose.diagnose import Found, pose, search
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.evidence import Evidence, rivals, verdict_of
from dynreg.diagnose.fit import fit
from dynreg.diagnose.gained import window_errors
from dynreg.diagnose.hypothesis import Hypothesis, single_terms
from dynreg.diagnose.interval import posterior
from dynreg.diagnose.name import calibrate
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.settings import Settings, TrialSettings
from dynreg.diagnose.threshold import USUAL, null_score, null_seed, threshold
from dynreg.diagnose.truth import Hidden, Protocol, hide, log_of, protocol
from dynreg.errors import UsageError
from dynreg.registry import Registry
from dynreg.replay.parts import Parts
from dynreg.results.trials import TrialResult, TrialTable
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Term, one_group, term
from dynreg.sim.robot import Robot

Progress = Callable[[str, int, int], None]


def trial(
    registry: Registry | None,
    robot: Robot,
    settings: TrialSettings,
    progress: Progress | None = None,
) -> TrialTable:
    """Hide, diagnose and score `settings.count` robots (of each effect, with hide = "every").

    All robots get the same commands, so that one threshold serves them all.
    """
    report = progress or (lambda *_: None)
    plan = protocol(robot, seed=settings.seed, seconds=settings.seconds)
    jobs = _jobs(robot, settings)
    needed = trial_threshold(registry, robot, plan, settings, progress)
    results = []
    for number, (terms, size, seed) in enumerate(jobs):
        report("trials", number, len(jobs))
        results.append(one_trial(robot, plan, terms, size, seed, needed, settings))
    report("trials", len(jobs), len(jobs))
    notes = [f"threshold {needed:.3g} nats, from {settings.threshold_runs} robots without an effect"]
    return TrialTable.of(robot.name, results, notes)


def trial_threshold(
    registry: Registry | None,
    robot: Robot,
    plan: Protocol,
    settings: TrialSettings,
    progress: Progress | None = None,
) -> float:
    """[nats] that a cause needs under the protocol's commands."""
    if settings.threshold_runs == 0:
        return USUAL
    posed, seed = _without_effect(robot, plan, settings)
    return threshold(registry, *posed, runs=settings.threshold_runs, seed=seed, progress=progress).nats


def null_scores(robot: Robot, plan: Protocol, settings: TrialSettings, numbers: Iterable[int]) -> list[float]:
    """[nats] of the robots without an effect of these numbers, which `trial_threshold` finds its threshold by."""
    posed, seed = _without_effect(robot, plan, settings)
    return [null_score(*posed, null_seed(seed, i)) for i in numbers]


def _without_effect(
    robot: Robot, plan: Protocol, settings: TrialSettings
) -> tuple[tuple[Problem, list[Term], np.ndarray, np.ndarray], int]:
    """(problem, terms, fit windows, select windows) of a robot without an effect under the plan, and its seed."""
    seed = stream_seed(settings.seed, "threshold") % 2**31
    recording = log_of(robot, hide(robot, (), None, seed), plan, engine=_truth_engine(robot, settings))
    problem, split = pose(None, robot, recording, _blind(plan, settings))
    terms = single_terms(robot)
    return (problem, terms, np.flatnonzero(split.fit), np.flatnonzero(split.select)), seed


def one_trial(
    robot: Robot,
    plan: Protocol,
    terms: tuple[Term, ...],
    size: str | None,
    seed: int,
    needed: float,
    settings: TrialSettings,
    *,
    without: tuple[str, ...] = (),
    max_causes: int = 1,
    share: bool = True,
    interval: bool = False,
) -> TrialResult:
    """Hide `terms` at `size` in the robot of `seed`, diagnose its log, score the first cause.

    share : whether to find the share of the attainable gain, which takes another fit. interval : whether to look if
    the 90 % interval of a rightly named effect's size holds the truth.
    """
    hidden = hide(robot, terms, size, seed)
    recording = log_of(robot, hidden, plan, engine=_truth_engine(robot, settings))
    began, busy = time.perf_counter(), time.process_time()
    blind = _blind(plan, settings, without=without, max_causes=max_causes)
    problem, split = pose(None, robot, recording, blind)
    fit_on, select_on = np.flatnonzero(split.fit), np.flatnonzero(split.select)
    found = search(None, problem, single_terms(robot, (), without), fit_on, select_on, blind, needed=needed)
    evidence = Evidence.of(found.problem, recording, found.extended, split.chosen)
    verdict = verdict_of(robot, evidence, found.rounds, found.accepted)
    seconds, core = time.perf_counter() - began, time.process_time() - busy
    scored = _scored(robot, problem, hidden, found, verdict, seconds)
    result = scored.model_copy(update={"core_seconds": core})
    if interval and result.parameter_error is not None:
        result = result.model_copy(update={"covered": _covered(found.problem, split, hidden, found)})
    if not share or not hidden.terms or not found.accepted:
        return result
    return result.model_copy(update={"share_of_attainable_gain": _share(problem, split, hidden, found)})


def _scored(
    robot: Robot, problem: Problem, hidden: Hidden, found: Found, verdict, seconds: float
) -> TrialResult:
    first = found.rounds[0].chosen.point.hypothesis.terms[-1] if found.accepted else None
    stated = (
        {first.key, *(s.point.hypothesis.terms[-1].key for s in found.rounds[0].equivalent)}
        if first
        else set()
    )
    causes = tuple(t.key for t in found.extended.hypothesis.terms)
    truths = [_same(robot, t) for t in hidden.terms]
    right = first is None
    if hidden.terms:
        stated_first = first is not None and any(first.key in truth for truth in truths)
        right = verdict in ("named", "ambiguous") and stated_first and all(t & {*causes} for t in truths)
    values = {
        p.name if len(hidden.terms) == 1 else f"{t.key}.{p.name}": float(v)
        for t, row in zip(hidden.terms, hidden.values, strict=True)
        for p, v in zip(t.effect.parameters, row, strict=True)
    }
    same = first is not None and len(hidden.terms) == 1 and first.key == hidden.terms[0].key
    return TrialResult(
        robot=robot.name,
        seed=hidden.seed,
        hidden="+".join(t.effect.id for t in hidden.terms) or None,
        size=hidden.size if hidden.terms else None,
        joints=tuple(j for t in hidden.terms for j in t.joints),
        hidden_values=values,
        true_parameters=robot.space.as_dict(hidden.parameters),
        named=first.key if first else None,
        causes=causes,
        verdict=verdict,
        right=right,
        joint_right=_joint_right(robot, hidden, first),
        false_alarm=not hidden.terms and first is not None,
        in_set=bool(stated & set().union(*truths)) if hidden.terms and first else None,
        size_of_set=1 + len(rivals(robot, found.rounds[0])) if first else 0,
        parameter_error=_size_error(problem, hidden, found) if same else None,
        seconds=seconds,
    )


def _same(robot: Robot, hidden: Term) -> set[str]:
    """Keys that name the same cause: the term's, and those of its exact group about the same joints."""
    return {hidden.key, *(t.key for t in single_terms(robot) if one_group(robot, hidden, t))}


def _joint_right(robot: Robot, hidden: Hidden, first: Term | None) -> bool | None:
    """Whether the cause sits in the joints where one is hidden; None where it does not sit in a joint.

    An effect of the whole robot that no commands tell from the hidden one sits there, too.
    """
    joints = tuple(j for t in hidden.terms for j in t.joints)
    if not joints:
        return None
    return first is not None and (
        first.joints == joints or any(first.key in _same(robot, t) for t in hidden.terms)
    )


def _share(problem: Problem, split, hidden: Hidden, found: Found) -> float | None:
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
        window_errors(problem, s, test).mean()
        for s in problem.states([found.base, found.extended, refitted], test)
    )
    return float((base - extended) / (base - best)) if base - best > 0.02 * base else None


def _covered(problem: Problem, split: Parts, hidden: Hidden, found: Found) -> bool:
    """Whether the 90 % interval of the effect's size holds the hidden one."""
    draws = posterior(problem, found.extended, split.chosen)
    size = next(iter(estimates(problem, found.extended, 0, draws).values()))
    return bool(size.low <= hidden.values[0][0] <= size.high)


def _size_error(problem: Problem, hidden: Hidden, found: Found) -> float:
    """Relative error of the effect's size."""
    c = problem.coordinates
    size = c.effect_values(found.extended.hypothesis, found.extended.effect[None])[0][0][0]
    return float(abs(size - hidden.values[0][0]) / abs(hidden.values[0][0]))


def _jobs(robot: Robot, settings: TrialSettings) -> list[tuple[tuple[Term, ...], str | None, int]]:
    """(terms, size, seed) of every robot."""
    shared = [t for t in single_terms(robot) if not t.joints]
    seeds = [stream_seed(settings.seed, "trial", i) % 2**31 for i in range(settings.count)]
    if settings.hide == "nothing":
        return [((), None, s) for s in seeds]
    if settings.hide == "every":
        return [((t,), settings.size, stream_seed(s, t.key) % 2**31) for t in shared for s in seeds]
    if settings.hide == "drawn":
        draw = stream(settings.seed, "hidden effects").integers(0, len(shared), settings.count)
        return [((shared[d],), settings.size, s) for d, s in zip(draw, seeds, strict=True)]
    chosen = tuple(term(key) for key in settings.effects)
    for t in chosen:
        unknown = set(t.joints) - {*robot.joints}
        reason = f"it has no joint {min(unknown)!r}" if unknown else t.effect.why_not(robot)
        if reason:
            raise UsageError(
                f"effect {t.key!r} on robot {robot.name!r}: {reason}",
                expected="an effect that can act there",
                do=f"see `dynreg effects {robot.name}`",
            )
    return [(chosen, settings.size, s) for s in seeds]


def _truth_engine(robot: Robot, settings: TrialSettings) -> str | None:
    """Another engine than the diagnosis runs on, where the robot has one."""
    mine = robot.running(settings.engine)
    others = [e for e in robot.engines if e != mine]
    return others[0] if others else mine


def _blind(plan: Protocol, settings: TrialSettings, **more) -> Settings:
    tests = ",".join(n for n in plan.names if n.startswith("test"))
    return Settings(
        hold_out=tests,
        engine=settings.engine,
        threshold_runs=settings.threshold_runs,
        threads=settings.threads,
        **more,
    )

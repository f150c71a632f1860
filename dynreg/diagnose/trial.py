"""Trials: diagnose the logs of simulated robots with hidden effects, and compare the answer with the truth."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.diagnose import Diagnosed, search
from dynreg.diagnose.guided import guided
from dynreg.diagnose.independent import hide_independent, independent_log
from dynreg.diagnose.noise import own_noise
from dynreg.diagnose.options import DiagnosisOptions, Ranker
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.ranking.guide import Guide
from dynreg.diagnose.threshold import Cache, Nulls, Threshold, known, null_seed, nulls_of, threshold
from dynreg.evidence.estimate import estimates
from dynreg.evidence.fit import fit
from dynreg.evidence.hypothesis import Hypothesis, single_terms
from dynreg.evidence.interval import posterior
from dynreg.evidence.lockstep import Search, run, together
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Hidden, Protocol, hide, log_of, measured_states, recorded
from dynreg.progress import Progress
from dynreg.rng import stream_seed
from dynreg.sim.effects import Term, one_group
from dynreg.sim.robot import Robot

LEAST = (
    0.02  # of the calibrated error: if the true structure gains less, a share of the gain is mostly chance
)


@dataclass(frozen=True)
class Trials:
    """Simulated robots under one protocol, which share one threshold, and the settings of their diagnosis.

    engine : of the diagnosis; None for the robot's first. threshold_runs, threads : as in `DiagnosisOptions`.
    seed : of the robots without an effect that determine the threshold. truth : "own" simulates the hidden robots by
    the library's effects, "independent" by other code (`dynreg.truths`). ranker : as in `DiagnosisOptions`;
    guide : what it stands for, which all of them share; None without one (see `guided`).
    """

    robot: Robot
    plan: Protocol
    engine: str | None = None
    threshold_runs: int = DiagnosisOptions.threshold_runs
    threads: int = 0
    seed: int = 0
    truth: str = "own"
    ranker: Ranker = DiagnosisOptions.ranker
    guide: Guide | None = None

    @property
    def truth_engine(self) -> str:
        """The engine of the simulated robots: another one than that of the diagnosis, if the robot has one."""
        mine = self.robot.running(self.engine)
        others = [e for e in self.robot.engines if e != mine]
        return others[0] if others else mine

    def options(self, without: tuple[str, ...] = (), max_causes: int = 1) -> DiagnosisOptions:
        """The options of the diagnosis, which contain nothing of the truth."""
        return DiagnosisOptions(
            hold_out=",".join(n for n in self.plan.names if n.startswith("test")),
            without=without,
            max_causes=max_causes,
            engine=self.engine,
            threshold_runs=self.threshold_runs,
            threads=self.threads,
            ranker=self.ranker,
        )

    def guided(
        self, cache: Cache | None = None, progress: Progress | None = None, count: int | None = None
    ) -> "Trials":
        """The same with their guide, if their plan has one: a population under the protocol's commands.

        count : its entries; None for the usual number.
        """
        recording, options = _without_effect(self)

        def made() -> Search[Problem]:
            problem = yield from posed(self, recording, options)
            return (yield from guided(problem, recording, options, cache, progress, count))

        return replace(self, guide=run(made(), threads=self.threads).guide)


@dataclass(frozen=True)
class Trial:
    """One trial: the hidden `terms` at `size` in the robot of `seed`, and the limits of its diagnosis.

    without : effects that are no candidates. max_causes : most causes to name. cause : what an independent truth hides
    in place of terms, "backlash[elbow]" in one joint; None for nothing.
    """

    terms: tuple[Term, ...]
    size: str | None
    seed: int
    without: tuple[str, ...] = ()
    max_causes: int = 1
    cause: str | None = None


@dataclass(frozen=True)
class Tried:
    """A robot with hidden effects and its diagnosis. seconds, core_seconds : wall time, and time of all cores."""

    hidden: Hidden
    made: Diagnosed
    seconds: float
    core_seconds: float

    @property
    def first(self) -> Term | None:
        """The first cause; None without one."""
        found = self.made.found
        return found.rounds[0].chosen.point.hypothesis.terms[-1] if found.accepted else None


def trial_threshold(
    trials: Trials, cache: Cache | None = None, progress: Progress | None = None, nulls: Nulls | None = None
) -> Threshold:
    """The threshold under the protocol's commands; see `threshold`, also for `nulls`."""
    recording, options = _without_effect(trials)

    def found() -> Search[Threshold]:
        problem = yield from posed(trials, recording, options)
        return (yield from threshold(problem, recording, options, cache, progress, nulls))

    return run(found(), threads=trials.threads)


def nulls(trials: Trials, numbers: Iterable[int]) -> list[tuple[float, float]]:
    """`threshold.null` of the robots without an effect of these numbers; `trial_threshold` uses the same robots."""
    return run(null_search(trials, numbers), threads=trials.threads)


def null_search(trials: Trials, numbers: Iterable[int]) -> Search[list[tuple[float, float]]]:
    """The search for `nulls`."""
    recording, options = _without_effect(trials)
    problem = yield from posed(trials, recording, options)
    seeds = [null_seed(options.seed, i) for i in numbers]
    noise = own_noise(trials.robot, problem.train_part(recording))
    return (yield from nulls_of(problem, noise, seeds))


def _without_effect(trials: Trials) -> tuple[Recording, DiagnosisOptions]:
    """The log of a robot without an effect under the protocol, and the options of the threshold."""
    options = replace(trials.options(), seed=stream_seed(trials.seed, "threshold") % 2**31)
    hidden = hide(trials.robot, (), None, options.seed)
    return log_of(trials.robot, hidden, trials.plan, engine=trials.truth_engine), options


def posed(trials: Trials, recording: Recording, options: DiagnosisOptions) -> Search[Problem]:
    """A log of the trials as a problem, with their guide."""
    model, data = pose(trials.robot, recording, options)
    problem = yield from planned(model, data, single_terms(trials.robot, (), options.without))
    return replace(problem, guide=trials.guide)


def tried(trials: Trials, todo: Sequence[Trial], needed: Threshold) -> list[Tried]:
    """Hide effects in robots and diagnose their logs, all in lockstep; a cause needs what `needed` says.

    The time that all took is shared out evenly.
    """
    made = run(together(_hidden_log(trials, one) for one in todo), threads=trials.threads)
    hidden, logs = zip(*made, strict=True)
    began, busy = time.perf_counter(), time.process_time()

    def diagnosed(one: Trial, recording: Recording) -> Search[Diagnosed]:
        options = trials.options(one.without, one.max_causes)
        problem = yield from posed(trials, recording, options)
        return (yield from search(problem, recording, known(needed), options))

    searches = [diagnosed(*one) for one in zip(todo, logs, strict=True)]
    made = run(together(searches), threads=trials.threads)
    spent = (time.perf_counter() - began) / len(todo), (time.process_time() - busy) / len(todo)
    return [Tried(*one, *spent) for one in zip(hidden, made, strict=True)]


def hidden_log(trials: Trials, one: Trial) -> tuple[Hidden, Recording]:
    """What a trial hides, and its log."""
    return run(_hidden_log(trials, one), threads=trials.threads)


def _hidden_log(trials: Trials, one: Trial) -> Search[tuple[Hidden, Recording]]:
    robot, plan = trials.robot, trials.plan
    if trials.truth == "independent":
        hidden, truth = hide_independent(robot, one.cause, one.size, one.seed)
        return hidden, independent_log(robot, truth, plan)
    hidden = hide(robot, one.terms, one.size, one.seed)
    states = yield from measured_states(robot, hidden, plan.run, engine=trials.truth_engine)
    return hidden, recorded(robot, plan, states)


def right_names(robot: Robot, hidden: Hidden) -> list[set[str]]:
    """For each hidden cause the keys that name it right; none where nothing is hidden, or nothing with a name."""
    if hidden.cause is not None:
        return [set().union(*(same_cause(robot, t) for t in hidden.answers))] if hidden.answers else []
    return [same_cause(robot, t) for t in hidden.terms]


def same_cause(robot: Robot, hidden: Term) -> set[str]:
    """Keys that name the same cause: the term's, and those of its exact group about the same joints."""
    return {hidden.key, *(t.key for t in single_terms(robot) if one_group(robot, hidden, t))}


def joint_right(robot: Robot, hidden: Hidden, first: Term | None) -> bool | None:
    """Whether the cause sits in the joints (the body) where one is hidden; None where it does not sit in one.

    An effect of the whole robot that no commands tell from the hidden one sits there, too.
    """
    places = hidden.places
    if not places:
        return None
    return first is not None and (
        first.at == places or any(first.key in names for names in right_names(robot, hidden))
    )


def attainable_share(trials: Trials, one: Tried) -> float | None:
    """(calibrated - extended) / (calibrated - true structure refitted) on test; None where nothing can be won."""
    problem, found, hidden = one.made.problem, one.made.found, one.hidden
    model, data = problem.model, problem.data
    if not data.parts.test.any():
        return None
    c = model.coordinates
    effect = np.concatenate(
        [c.effect_coordinates(t, v) for t, v in zip(hidden.terms, hidden.values, strict=True)]
    )
    true = Point(Hypothesis(hidden.terms), c.from_values(hidden.parameters), effect)
    test = np.flatnonzero(data.parts.test)

    def share() -> Search[tuple[float, ...]]:
        (refitted,), _ = yield from fit(found.model, [true], found.pooled, iterations=2)
        points = [found.base, found.current, refitted]
        states = yield from model.states(points, data.windows.run.take(test))
        return tuple(float(data.window_errors(s, test).mean()) for s in states)

    base, extended, best = run(share(), threads=trials.threads)
    return (base - extended) / (base - best) if base - best > LEAST * base else None


def covered(trials: Trials, one: Tried) -> bool:
    """Whether the 90 % interval of the effect's size holds the hidden one, in the zeros that it was fitted with."""
    found = one.made.found
    sample = found.data.sample(found.data.parts.chosen)
    draws = run(posterior(found.model, found.current, sample), threads=trials.threads)
    size = next(iter(estimates(found.model, found.current, 0, draws).values()))
    return bool(size.low <= one.hidden.values[0][0] <= size.high)


def size_error(one: Tried) -> float:
    """Relative error of the effect's size."""
    found, true = one.made.found, one.hidden.values[0][0]
    point = found.current
    size = found.model.coordinates.effect_values(point.hypothesis, point.effect[None])[0][0][0]
    return float(abs(size - true) / abs(true))

"""Trial: how often a diagnosis names the right effect on simulated robots with a hidden effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.sim.sizes import SIZES
from dynreg.verbs.diagnose import threshold_runs
from dynreg.verbs.settings import Settings, address, executor, option, seed, threads

if TYPE_CHECKING:
    from dynreg.diagnose.trial import Trial, Trials
    from dynreg.results.trials import TrialTable
    from dynreg.sim.robot import Robot
    from dynreg.verbs.nulls import Null
    from dynreg.verbs.verb import Built

HIDES = ("drawn", "chosen", "nothing", "every")
TOGETHER = 8  # robots diagnosed in lockstep: more take more memory, and save no time
TRUTHS = ("own", "independent")
PHYSICS = ("same", "other")


@dataclass(frozen=True)
class TrialSettings(Settings):
    """The settings of a trial: the hidden effects, the number of robots, and the length of their logs.

    hide : "drawn" (one random effect per robot), "chosen" (all of `effects` in each robot), "nothing", or
        "every" (each effect that the robot can have, `count` robots with each).
    truth, physics : "independent" robots are simulated by other code than the model's, with the library's physics or
        other; `effects` are then one of their causes.
    Raises UsageError if `effects` is given without "chosen", or "chosen" without `effects`, or an effect twice; and for
    other physics of the library's own robots.
    """

    hide: str = option("drawn", "How hidden effects are chosen.", choices=HIDES, flag=None)
    effects: tuple[str, ...] = option((), "Effects to hide, all in each robot.", flag=None)
    size: str = option("medium", "Size of the hidden effect.", choices=SIZES)
    count: int = option(1, "Number of robots.", flag="-n", least=1)
    seed: int = seed()
    seconds: float = option(50.0, "Length of each robot's log [s].", above=0.0)
    truth: str = option(
        "own", "Code that simulates the hidden robots: the library's, or independent.", choices=TRUTHS
    )
    physics: str = option(
        "same",
        "Physics of the causes that are drawn for independent robots: the library's, or other.",
        choices=PHYSICS,
    )
    engine: str | None = option(None, "Engine of the diagnosis.", usual="the robot's first")
    threshold_runs: int = threshold_runs()
    threads: int = threads()
    executor: str = executor()
    address: str | None = address()

    def __post_init__(self) -> None:
        from dynreg.sim.effects import term

        super().__post_init__()
        if (self.hide == "chosen") != bool(self.effects):
            raise UsageError(
                f"hide {self.hide!r} with effects {list(self.effects)}",
                expected="effects if and only if hide is 'chosen'",
                do="name effects, or change `hide`",
            )
        if self.hide == "nothing" and self.size != "medium":
            raise UsageError(
                f"size {self.size!r} of a hidden effect where nothing is hidden",
                expected="a size with an effect",
                do="leave out --size, or --none",
            )
        if self.physics != "same" and self.truth == "own":
            raise UsageError(
                f"physics {self.physics!r} without truth 'independent'",
                expected="'same': the library's own hidden robots have its physics",
                do="add `--truth independent`, or leave `--physics` out",
            )
        hidden = [term(key) for key in self.effects] if self.truth == "own" else []
        told = [(one.effect.id, *sorted(one.at)) for one in hidden] or self.effects
        if twice := [key for i, key in enumerate(self.effects) if told[i] in told[:i]]:
            raise UsageError(
                f"effect {twice[0]!r} twice in one robot",
                expected="different effects, or one at different places",
                do="name each once",
            )


def trial(asked: "Built", settings: TrialSettings, progress: Progress | None = None) -> "TrialTable":
    """Hide effects in simulated robots and diagnose them.

    The simulated robots have parameters off their nameplate, sensor noise, and a finer time step than the model. A
    trial that was interrupted goes on with the same command.

    Example: dynreg trial servo_pendulum --effect load_friction --size weak -n 10
    """
    from dynreg.diagnose.trial import trial_threshold
    from dynreg.executor import Local, opened
    from dynreg.results.trials import TrialResult, TrialTable
    from dynreg.verbs.nulls import HandedOut
    from dynreg.verbs.plain import plain_robot

    report, many, results = progress or (lambda *_: None), len(todo_of(asked.robot, settings)), []
    told = {"robot": plain_robot(asked.robot), "settings": vars(settings)}
    with opened(settings.executor, settings.address, settings.threads) as executor:
        told["threads"] = executor.threads
        nulls = None if isinstance(executor, Local) else HandedOut(executor, null_of_trials, told)
        trials = trials_of(asked.robot, settings, executor.threads)
        needed = trial_threshold(trials, asked.registry, progress, nulls)
        size = min(TOGETHER, -(-many // executor.workers))
        spans = [(first, min(first + size, many)) for first in range(0, many, size)]
        key = _key(asked.robot, settings, vars(needed))
        known = {span: asked.registry.cached("trial", key | {"span": span}) for span in spans}
        jobs = [told | {"span": s, "needed": vars(needed)} for s in spans if known[s] is None]
        report("trials", 0, many)
        new = iter(executor.map(tried_some, jobs))
        for span in spans:
            if known[span] is None:  # kept at once, so that an interrupted trial goes on
                known[span] = {"results": next(new)}
                asked.registry.cache("trial", key | {"span": span}, known[span])
            results += [TrialResult(**one) for one in known[span]["results"]]
            report("trials", len(results), many)
    notes = [
        f"threshold: {needed.nats:.3g} nats, from {settings.threshold_runs} simulated robots without an effect"
    ]
    return TrialTable.of(asked.robot.name, results, notes)


def _key(robot: "Robot", settings: TrialSettings, needed: Mapping[str, Any]) -> dict[str, Any]:
    """What makes the results of robots these: all but what does the work."""
    from dynreg.diagnose.threshold import SEARCH
    from dynreg.sim.versions import versions

    how = {
        name: value
        for name, value in vars(settings).items()
        if name not in ("threads", "executor", "address")
    }
    return {"robot": robot.hash, "settings": how, "needed": needed, "search": SEARCH, "versions": versions()}


def trials_of(robot: "Robot", settings: TrialSettings, threads: int) -> "Trials":
    """The simulated robots of a trial, under its protocol. Raises UsageError as `protocol`."""
    from dynreg.diagnose.trial import Trials
    from dynreg.evidence.truth import protocol

    plan = protocol(robot, seed=settings.seed, seconds=settings.seconds)
    how = settings.engine, settings.threshold_runs, threads, settings.seed, settings.truth
    return Trials(robot, plan, *how)


def todo_of(robot: "Robot", settings: TrialSettings) -> "list[Trial]":
    """What each robot of a trial hides. Raises UsageError where it cannot."""
    from dynreg.verbs.trials import independent_jobs, jobs

    what = robot, settings.hide, settings.effects, settings.size, settings.count, settings.seed
    return jobs(*what) if settings.truth == "own" else independent_jobs(*what, settings.physics)


def tried_some(
    robot: Mapping[str, Any],
    settings: Mapping[str, Any],
    span: Sequence[int],
    needed: Mapping[str, Any],
    threads: int,
) -> list[dict[str, Any]]:
    """The results of some of a trial's robots: those from number `span[0]` to before `span[1]`, in lockstep.

    robot : see `plain_robot`. settings, needed : of `TrialSettings` and of a `Threshold`.
    """
    from dynreg.diagnose.threshold import Threshold
    from dynreg.verbs.plain import robot_from
    from dynreg.verbs.trials import results_of

    built, told = robot_from(robot), TrialSettings(**settings)
    todo = todo_of(built, told)[slice(*span)]
    found = results_of(trials_of(built, told, threads), todo, Threshold(**needed))
    return [one.model_dump() for one in found]


def null_of_trials(
    robot: Mapping[str, Any], settings: Mapping[str, Any], number: int, threads: int
) -> "Null":
    """Robot `number` without an effect, under the protocol of a trial. settings : of `TrialSettings`."""
    from dynreg.diagnose.trial import null_search
    from dynreg.verbs.nulls import ran
    from dynreg.verbs.plain import robot_from

    trials = trials_of(robot_from(robot), TrialSettings(**settings), threads)
    return ran(null_search(trials, [number]), threads)

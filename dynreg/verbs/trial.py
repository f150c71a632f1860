"""Trial: how often a diagnosis is right about simulated robots whose truth is known."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.verbs.diagnose import threshold_runs
from dynreg.verbs.settings import Settings, option, seed, threads
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.results.trials import TrialTable
    from dynreg.verbs.verb import Built

HIDES = ("drawn", "chosen", "nothing", "every")
TOGETHER = 8  # robots that are diagnosed in lockstep: more take memory, and no less time
SIZES = ("weak", "medium", "strong")  # of `sim.effects`, which takes long to load


@dataclass(frozen=True)
class TrialSettings(Settings):
    """What a trial can be told: what robots hide, how many there are, and how long their logs.

    hide : "drawn" (each robot hides an effect drawn for it), "chosen" (those of `effects`, together), "nothing", or
        "every" (each effect that the robot can have, `count` robots with each).
    Raises UsageError where these do not fit together.
    """

    hide: str = option("drawn", "What robots hide.", choices=HIDES, flag=None)
    effects: tuple[str, ...] = option((), "What to hide, together.", flag=None)
    size: str = option("medium", "One of weak, medium or strong.", choices=SIZES)
    count: int = option(1, "Robots.", flag="-n", least=1)
    seed: int = seed()
    seconds: float = option(50.0, "Length of each robot's log [s].", above=0.0)
    engine: str | None = option(None, "Engine of the diagnosis.", usual="the robot's first")
    threshold_runs: int = threshold_runs()
    threads: int = threads()

    def __post_init__(self) -> None:
        from dynreg.sim.effects import term

        super().__post_init__()
        if (self.hide == "chosen") != bool(self.effects):
            raise UsageError(
                f"hide {self.hide!r} with effects {list(self.effects)}",
                expected="effects with 'chosen', and only there",
                do="name effects, or choose another way to hide",
            )
        for key in self.effects:
            term(key)


def trial(asked: "Built", settings: TrialSettings, progress: Progress | None = None) -> "TrialTable":
    """Hide an effect in simulated robots and see whether a diagnosis names it.

    The hidden robots have errors of their nameplate, noise and a finer simulation than the model's.

    Example: dynreg trial servo_pendulum --effect load_friction --size weak -n 10
    """
    from dynreg.diagnose.trial import Trials, trial_threshold
    from dynreg.evidence.truth import protocol
    from dynreg.results.trials import TrialTable
    from dynreg.verbs.trials import jobs, results_of

    report = progress or (lambda *_: None)
    plan = protocol(asked.robot, seed=settings.seed, seconds=settings.seconds)
    todo = jobs(asked.robot, settings.hide, settings.effects, settings.size, settings.count, settings.seed)
    how = settings.engine, settings.threshold_runs, settings.threads, settings.seed
    trials = Trials(asked.robot, plan, *how)
    needed = trial_threshold(trials, asked.registry, progress)
    results = []
    for number in range(0, len(todo), TOGETHER):
        report("trials", number, len(todo))
        results += results_of(trials, todo[number : number + TOGETHER], needed)
    report("trials", len(todo), len(todo))
    notes = [f"threshold {needed:.3g} nats, from {settings.threshold_runs} robots without an effect"]
    return TrialTable.of(asked.robot.name, results, notes)

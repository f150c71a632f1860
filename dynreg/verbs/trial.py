"""Trial: how often a diagnosis names the right effect on simulated robots with a hidden effect."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.verbs.diagnose import threshold_runs
from dynreg.verbs.settings import Settings, option, seed, threads

if TYPE_CHECKING:
    from dynreg.results.trials import TrialTable
    from dynreg.verbs.verb import Built

HIDES = ("drawn", "chosen", "nothing", "every")
TOGETHER = 8  # robots diagnosed in lockstep: more take more memory, and save no time
TRUTHS = ("own", "independent")
PHYSICS = ("same", "other")
SIZES = ("weak", "medium", "strong")  # as in `sim.effects`, whose import takes long


@dataclass(frozen=True)
class TrialSettings(Settings):
    """The settings of a trial: the hidden effects, the number of robots, and the length of their logs.

    hide : "drawn" (one random effect per robot), "chosen" (all of `effects` in each robot), "nothing", or
        "every" (each effect that the robot can have, `count` robots with each).
    truth, physics : "independent" robots are simulated by other code than the model's, with the library's physics or
        other; `effects` are then one of their causes.
    Raises UsageError if `effects` is given without "chosen", or "chosen" without `effects`; and for other physics of
    the library's own robots.
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

    def __post_init__(self) -> None:
        from dynreg.sim.effects import term

        super().__post_init__()
        if (self.hide == "chosen") != bool(self.effects):
            raise UsageError(
                f"hide {self.hide!r} with effects {list(self.effects)}",
                expected="effects if and only if hide is 'chosen'",
                do="name effects, or change `hide`",
            )
        if self.physics != "same" and self.truth == "own":
            raise UsageError(
                f"physics {self.physics!r} without truth 'independent'",
                expected="'same': the library's own hidden robots have its physics",
                do="add `--truth independent`, or leave `--physics` out",
            )
        for key in self.effects if self.truth == "own" else ():
            term(key)


def trial(asked: "Built", settings: TrialSettings, progress: Progress | None = None) -> "TrialTable":
    """Hide effects in simulated robots and diagnose them.

    The simulated robots have parameters off their nameplate, sensor noise, and a finer time step than the model.

    Example: dynreg trial servo_pendulum --effect load_friction --size weak -n 10
    """
    from dynreg.diagnose.trial import Trials, trial_threshold
    from dynreg.evidence.truth import protocol
    from dynreg.results.trials import TrialTable
    from dynreg.verbs.trials import independent_jobs, jobs, results_of

    report = progress or (lambda *_: None)
    plan = protocol(asked.robot, seed=settings.seed, seconds=settings.seconds)
    what = asked.robot, settings.hide, settings.effects, settings.size, settings.count, settings.seed
    todo = jobs(*what) if settings.truth == "own" else independent_jobs(*what, settings.physics)
    how = settings.engine, settings.threshold_runs, settings.threads, settings.seed, settings.truth
    trials = Trials(asked.robot, plan, *how)
    needed = trial_threshold(trials, asked.registry, progress)
    results = []
    for number in range(0, len(todo), TOGETHER):
        report("trials", number, len(todo))
        results += results_of(trials, todo[number : number + TOGETHER], needed)
    report("trials", len(todo), len(todo))
    notes = [
        f"threshold: {needed.nats:.3g} nats, from {settings.threshold_runs} simulated robots without an effect"
    ]
    return TrialTable.of(asked.robot.name, results, notes)

"""Diagnose: which physical causes a simulator of a recorded robot lacks."""

import time
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from dynreg.diagnose.options import DiagnosisOptions
from dynreg.errors import UsageError
from dynreg.verbs.settings import Settings, hold_out, option, seed, threads
from dynreg.verbs.simulators import NAMES, NOMINAL, OLD, own, simulator
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    import numpy as np

    from dynreg.results.diagnosis import Diagnosis
    from dynreg.sim.effects import Terms
    from dynreg.sim.robot import Robot
    from dynreg.verbs.subjects import Recorded

MOST_CAUSES = 10


def threshold_runs() -> int:
    """The setting of how a threshold is found."""
    return option(
        DiagnosisOptions.threshold_runs,
        "Simulations without an effect that set the threshold; 0 for the usual one.",
        least=0,
    )


@dataclass(frozen=True)
class DiagnoseSettings(Settings):
    """What a diagnosis can be told.

    Raises UsageError for an unknown effect, one that is asked for and left out, or a number that is too small.
    """

    start: str = option(
        NOMINAL,
        f"Simulator to begin from: {', '.join(NAMES)} or an ID.",
        metavar="ID",
        old=OLD,
    )
    hold_out: str | None = hold_out()
    effects: tuple[str, ...] | None = option(
        None,
        "Only these effects.",
        usual="all that fit",
        metavar="A,B",
        complete="effect_names",
        some="effects",
        see="effects",
    )
    without: tuple[str, ...] = option((), "Not these effects.", metavar="A,B", complete="effect_names")
    max_causes: int = option(DiagnosisOptions.max_causes, "Most causes to name.", least=1, most=MOST_CAUSES)
    engine: str | None = option(None, "One of the robot's engines.", usual="its first")
    seed: int = seed()
    threshold_runs: int = threshold_runs()
    tolerance: float = option(
        DiagnosisOptions.tolerance,
        "Factor on the nameplate's tolerances; above 1 where parameters are guesses.",
        above=0.0,
    )
    horizon: float | None = option(None, "Longest rollout in seconds.", usual="the robot's, or 10", above=0.0)
    joints: tuple[str, ...] | None = option(
        None,
        "Diagnose these joints alone.",
        usual="all, together",
        metavar="A,B",
        some="joints",
        see="robots",
    )
    windows: int | None = option(
        None, "Most rollouts to fit, and as many to select by.", usual="all", least=1
    )
    threads: int = threads()

    def __post_init__(self) -> None:
        from dynreg.sim.effects import effect

        super().__post_init__()
        if self.joints is not None:
            object.__setattr__(self, "joints", tuple(dict.fromkeys(self.joints)))
        for name in (*(self.effects or ()), *self.without):
            effect(name)
        both = sorted({*(self.effects or ())} & {*self.without})
        if both:
            raise UsageError(
                f"effects {both} are asked for and left out",
                expected="one of the two",
                do="drop them from one",
            )
        if not self.start:
            raise UsageError(
                "start ''",
                expected=f"one of {', '.join(NAMES)}, or an id",
                do="name one of these",
                setting="start",
            )

    @property
    def options(self) -> DiagnosisOptions:
        """What the search for causes needs of it: all but the simulator to begin from."""
        return DiagnosisOptions(**{one.name: getattr(self, one.name) for one in fields(DiagnosisOptions)})


def diagnose(asked: "Recorded", settings: DiagnoseSettings, progress: Progress | None = None) -> "Diagnosis":
    """Name the physical causes that a robot's simulator lacks.

    Parameters and effects are fitted together; an effect is named only above what chance reaches on this
    robot. The verdict is named, ambiguous, partly_explained, unknown or none. It needs no population.

    Exit status 0 whatever the verdict of a finished diagnosis.

    Example: dynreg diagnose monday --hold-out kp=400 --report monday.html

    Raises as `diagnose.diagnose`. The calibrated and the extended simulator are registered.
    """
    from dynreg.diagnose.account import told
    from dynreg.diagnose.diagnose import diagnose as find
    from dynreg.evidence.lockstep import counted, run
    from dynreg.results.result import Cost
    from dynreg.verbs.diagnosis import document

    began = time.perf_counter()
    registry, robot, recording, options = asked.registry, asked.robot, asked.recording, settings.options
    start = None
    if settings.start != NOMINAL:
        start = own(simulator(registry, settings.start, robot, recording.id), robot).config
    search = find(robot, recording, options, start, cache=registry, progress=progress)
    (made, seen), rollouts = run(counted(told(search, options)), threads=options.threads)
    ids = {kind: _register(asked, robot, kind, *one) for kind, one in seen.simulators.items()}
    cost = Cost(evaluations=0, rollouts=rollouts, test_rollouts=seen.simulated, seconds=0.0)
    found = document(asked, settings.start, options, made, seen, ids, cost)
    cost = cost.model_copy(update={"seconds": time.perf_counter() - began})
    return found.model_copy(update={"cost": cost})


def _register(
    asked: "Recorded", robot: "Robot", kind: str, values: "np.ndarray", terms: "Terms | None"
) -> str:
    """The id of a simulator that a diagnosis leaves, registered."""
    from dynreg.sim.config import SimConfig

    effects = {}
    for term, row in zip(terms.terms, terms.values, strict=True) if terms else ():
        effects[term.key] = {p.name: float(v) for p, v in zip(term.effect.parameters, row[0], strict=True)}
    config = SimConfig(robot.hash, robot.name, robot.space.as_dict(values), effects).as_dict()
    lineage = {"made_by": "diagnose", "kind": kind, "recording": asked.recording.id}
    return asked.registry.put_simulator(config | {"lineage": lineage})

"""Diagnose: which physical causes a simulator of a recorded robot lacks."""

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from dynreg.diagnose.options import DiagnosisOptions
from dynreg.errors import Assumed, UsageError, command, quoted
from dynreg.evidence.many import MANY
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, address, executor, hold_out, option, seed, threads
from dynreg.verbs.simulator import NAMES, NOMINAL, OLD
from dynreg.verbs.simulators import own, simulator

if TYPE_CHECKING:
    import numpy as np

    from dynreg.diagnose.diagnose import Diagnosed
    from dynreg.evidence.lockstep import Search
    from dynreg.results.diagnosis import Diagnosis
    from dynreg.sim.config import SimConfig
    from dynreg.sim.effects import Terms
    from dynreg.sim.robot import Robot
    from dynreg.verbs.nulls import HandedOut
    from dynreg.verbs.subjects import Recorded

MOST_CAUSES = 10
JUDGED = "errors and intervals"  # the stage after the search for causes
# The threshold takes most of the simulations; the others of these ask for fewer terms, or for fewer rollouts of each.
_NO_RUNS, _FEW = "--threshold-runs 0", 8
_FEW_WINDOWS = f"--windows {_FEW}"
# A log of 40 s has but four rollouts of 10 s: eight windows leave none out there. On an arm of six joints half of the
# expected simulations took 66 core seconds with eight windows, and 33 with this. One joint, or some effects, make no
# shorter list of simulations: a short list of terms is refitted more thoroughly.
_FIRST_LOOK, _ONE = "--windows 4", "--max-causes 1"
_SHORT = 2.0  # s of a rollout of a first look
MOST_DRIVEN = 3  # joints: with more of them, or a free base, a diagnosis that is not made faster takes hours


def _of(robots: str, help: str) -> str:
    """The help of a setting, with the robots first that alone have it, where it is not of all."""
    return f"{robots}: {help[0].lower()}{help[1:]}" if robots else help


def faster(settings: "DiagnoseSettings") -> str:
    """What makes a diagnosis with these settings faster; "" where nothing is left."""
    slow = {  # whether a setting can still be made faster by what to write, what saves most first
        _NO_RUNS: settings.threshold_runs > 0,
        "--joints A,B": not settings.joints,
        "--effects A,B": not settings.effects,
        _FEW_WINDOWS: settings.windows is None or settings.windows > _FEW,
    }
    left = [how for how, helps in slow.items() if helps]
    if not left:
        return ""
    named = " or ".join([", ".join(left[:-1]), left[-1]] if left[1:] else left)
    return f"{named} {'make' if left[1:] else 'makes'} it faster"


def first_command(recording: str, robot: "Robot") -> str:
    """The command of a first diagnosis of a recording: the quick one where another would take hours."""
    if not robot.floating and len(robot.driven) <= MOST_DRIVEN:
        return command("diagnose", recording)
    stated = robot.file.replay.horizon
    short = ["--horizon", f"{_SHORT:g}"] if stated is None or stated > _SHORT else []
    if not robot.floating:
        few = [*_FIRST_LOOK.split(), *short, *_ONE.split()]
        return command("diagnose", recording, *few, *_NO_RUNS.split())
    quick = [*_FEW_WINDOWS.split(), *_NO_RUNS.split()]
    if len(robot.space) > MANY:  # a list of each joint's own effects takes hours
        from dynreg.sim.effects import applicable

        whole = [name for name, effect in applicable(robot).items() if effect.scope != "joint"]
        quick += [*short, "--effects", ",".join(whole)]
    return command("diagnose", recording, *quick)


def _tell_longer(robot: "Robot", asked: float | None) -> None:
    """Warn where rollouts are asked for that are longer than the robot's own: they may drift apart."""
    own = robot.file.replay.horizon
    if own is not None and asked is not None and asked > own:
        warnings.warn(
            f"a horizon of {asked:g} s makes rollouts up to {asked / own:.2g} times as long as `[replay] horizon` in "
            f"the robot.toml of {robot.name!r} ({own:g} s), beyond which they may drift apart. Leave the horizon out, "
            "and they have that length",
            Assumed,
            2,
        )


def threshold_runs(of: str = "") -> int:
    """The setting of how a threshold is found."""
    return option(
        DiagnosisOptions.threshold_runs,
        _of(of, "Simulations without an effect that set the threshold; 0 for the usual one."),
        least=0,
    )


def tolerance(of: str = "") -> float:
    """The setting of how sure the nameplate is."""
    return option(
        DiagnosisOptions.tolerance,
        _of(of, "Factor on the nameplate's tolerances; above 1 where parameters are guesses."),
        above=0.0,
    )


def horizon(of: str = "") -> float | None:
    """The setting of how long rollouts are."""
    return option(
        None,
        _of(of, "Longest rollout in seconds."),
        usual="horizon under [replay] of robot.toml, or 10 without one",
        above=0.0,
    )


def windows(of: str = "") -> int | None:
    """The setting of how many rollouts are fitted."""
    return option(
        None, _of(of, "Most rollouts in the fit part, and in the select part."), usual="all", least=1
    )


def ranker(of: str = "") -> str:
    """The setting of what says which causes to try first."""
    about = (
        "Whether simulators with one effect each order the causes to try (auto: if they are registered; make: make "
        "them)."
    )
    return option(DiagnosisOptions.ranker, _of(of, about), choices=("auto", "make", "off"))


@dataclass(frozen=True)
class DiagnoseSettings(Settings):
    """The settings of a diagnosis.

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
        "Consider only these effects.",
        usual="all that fit",
        metavar="A,B",
        complete="effect_names",
        some="effects",
        see="effects",
    )
    without: tuple[str, ...] = option((), "Leave these effects out.", metavar="A,B", complete="effect_names")
    max_causes: int = option(
        DiagnosisOptions.max_causes, "Largest number of causes to name.", least=1, most=MOST_CAUSES
    )
    engine: str | None = option(None, "One of the robot's engines.", usual="its first")
    seed: int = seed()
    threshold_runs: int = threshold_runs()
    tolerance: float = tolerance()
    horizon: float | None = horizon()
    joints: tuple[str, ...] | None = option(
        None,
        "Diagnose only these joints.",
        usual="all, together",
        metavar="A,B",
        some="joints",
        see="robots",
    )
    windows: int | None = windows()
    ranker: str = ranker()
    threads: int = threads()
    executor: str = executor()
    address: str | None = address()

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
                f"effects {quoted(both)} are asked for and left out",
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

    A diagnosis fits parameters and effects together. It names an effect only if its evidence is above what chance
    reaches on this robot. The verdict is named, ambiguous, partly_explained, unknown or none. No population is needed.

    Several recordings of a robot get one verdict. Then each cause and parameter is fitted to each of them. The answer
    says what is the same in all, what differs, and what only one of them has.

    Exit status 0 whatever the verdict of a finished diagnosis.

    Example: dynreg diagnose monday --hold-out kp=400 --report monday.html

    Raises as `diagnose.diagnose`. The calibrated and the extended simulator are registered.
    """
    from dynreg.diagnose.account import with_account
    from dynreg.diagnose.diagnose import diagnose as find
    from dynreg.evidence.lockstep import counted, one_blas_thread, run
    from dynreg.results.result import Cost
    from dynreg.verbs.diagnosis import document

    began = time.perf_counter()
    registry, robot, recording, options = asked.registry, asked.robot, asked.recording, settings.options
    _tell_longer(robot, settings.horizon)
    begin = start = None
    if settings.start != NOMINAL:
        begin = own(simulator(registry, settings.start, robot, recording.id), robot)
        start = begin.config
    with _nulls(asked, settings, start) as nulls:
        search = find(robot, recording, options, start, cache=registry, progress=progress, nulls=nulls)
        search = with_account(_then_judged(search, progress), options)
        (made, seen), rollouts = run(counted(search), threads=options.threads)
        rollouts += nulls.rollouts if nulls else 0
    if progress:
        progress(JUDGED, 1, 1)
    parent = begin and begin.id
    made_here = {kind: _register(asked, robot, parent, kind, *one) for kind, one in seen.simulators.items()}
    ids = {"start": parent} | made_here
    cost = Cost(evaluations=0, rollouts=rollouts, test_rollouts=len(made.judged.states), seconds=0.0)
    with one_blas_thread():  # as in `run`: the same bytes on any number of threads
        found = document(asked, settings.start, options, made, seen, ids, cost)
    again = 0
    if asked.each:
        found, again = _told_apart(asked, found, options, progress)
    cost = cost.model_copy(update={"rollouts": rollouts + again, "seconds": time.perf_counter() - began})
    return found.model_copy(update={"cost": cost})


@contextmanager
def _nulls(
    asked: "Recorded", settings: DiagnoseSettings, start: "SimConfig | None"
) -> "Iterator[HandedOut | None]":
    """What computes the threshold's robots elsewhere, for the length of a block; None where this process does it."""
    from dynreg.executor import Local, opened
    from dynreg.verbs.nulls import HandedOut, null_of_diagnosis
    from dynreg.verbs.plain import plain_recording, plain_robot

    with opened(settings.executor, settings.address, settings.threads) as executor:
        if isinstance(executor, Local) or not settings.threshold_runs:
            yield None
            return
        job = {
            "robot": plain_robot(asked.robot),
            "recording": plain_recording(asked.recording),
            "start": None if start is None else start.as_dict(),
            "options": vars(settings.options),
            "threads": executor.threads,
        }
        yield HandedOut(executor, null_of_diagnosis, job)


def _then_judged(search: "Search[Diagnosed]", progress: Progress | None) -> "Search[Diagnosed]":
    """A search for causes, after which it is told that its evaluation begins: that may take minutes, too."""
    made = yield from search
    if progress:
        progress(JUDGED, 0, 1)
    return made


def _told_apart(
    asked: "Recorded", found: "Diagnosis", options: DiagnosisOptions, progress: Progress | None
) -> "tuple[Diagnosis, int]":
    """The verdict over several recordings, with values that are the same in all of them and values that differ.

    And how many simulations that took. A recording that cannot be fitted alone has a note in place of its values.
    """
    from dynreg.diagnose.refit import fit_alone, refits, with_own_effects
    from dynreg.evidence.lockstep import counted, run
    from dynreg.results.sentence import diagnosis_sentence
    from dynreg.verbs.diagnosis_words import not_fitted_alone
    from dynreg.verbs.refits import told
    from dynreg.verbs.simulators import stored

    every = {one.name: one.recording for one in asked.each}
    identity = found.extended_simulator or found.calibrated_simulator
    answer = stored(asked.registry, "simulator", identity, asked.robot).config
    each, why = fit_alone(asked.robot, every, options, answer)
    found = found.model_copy(
        update={"recordings": tuple(every), "notes": (*found.notes, *not_fitted_alone(why, len(each)))}
    )
    if len(each) < 2:
        return found, 0
    report = progress or (lambda *_: None)
    report("each recording", 0, 2)
    how = {"options": options, "limit": found.threshold_nats}
    search = counted(with_own_effects(asked.robot, each, answer=answer, **how))
    answer, alone = run(search, threads=options.threads)
    report("each recording", 1, 2)
    same, many = run(counted(refits(asked.robot, each, answer=answer, **how)), threads=options.threads)
    report("each recording", 2, 2)
    found = found.model_copy(update={"stable": tuple(told(one) for one in same.each)})
    return found.model_copy(update={"sentence": diagnosis_sentence(found)}), alone + many


def _register(
    asked: "Recorded",
    robot: "Robot",
    parent: str | None,
    kind: str,
    values: "np.ndarray",
    terms: "Terms | None",
) -> str:
    """The id of a simulator that a diagnosis leaves, registered; parent : of the one that it began with, if any."""
    from dynreg.sim.config import SimConfig, effects_of
    from dynreg.verbs.shaped import origin_of

    config = SimConfig.of(robot, values, effects_of(terms)).as_dict()
    lineage = origin_of(asked, "diagnose") | {"kind": kind} | ({} if parent is None else {"parent": parent})
    return asked.registry.put_simulator(config | {"lineage": lineage})

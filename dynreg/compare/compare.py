"""Models and simulators of a wheeled robot on one recording of it: errors and tests, times, paths (Pretorius et al.).

The commands of a recording, in the order of its episodes, are cut into 1000 to fit, 230 to validate and 230 to test of
each 1460. What a diagnosis or a query held out is a part of its own: a note says where simulators may have seen
commands to test.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.compare.contenders import MODELS, Making, Predicts, made
from dynreg.compare.paces import paces
from dynreg.compare.paths import driven, ends, runs
from dynreg.compare.simulated import replayed
from dynreg.compare.simulators import Simulator, simulators
from dynreg.data.recording import Recording
from dynreg.errors import LogError, UsageError
from dynreg.registry import Registry
from dynreg.results.comparison import Comparison, Contender, Errors
from dynreg.results.result import Cost
from dynreg.sim.robot import Robot
from dynreg.timed.commands import AXES
from dynreg.timed.compare import compared
from dynreg.wheeled import Told, pose_names, told

CUT = (1000, 1230, 1460)  # ends of the parts to fit, to validate and to test, as published
LEAST = 10  # commands of the last two parts
STILL = 1e-9  # m, rad: a displacement that does not change
SHORT = 0.1  # s: the shortest command of the published ones
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Settings:
    """What is asked for.

    models : names of `contenders.MODELS`. simulators : ids of simulators, entries or results, "nominal", or
    "diagnosis", "query", "calibration": the newest of the recording.
    seed : of every draw. starts : of the networks. generations : of the genetic algorithm that fits the unicycle.
    longest : seconds after which a command counts as another. threads : 0 for all cores; changes no number
    but the networks' last bits, which differ from run to run (`timed.networks.train`).
    """

    models: tuple[str, ...] = tuple(MODELS)
    simulators: tuple[str, ...] = ()
    seed: int = 0
    starts: int = 30
    generations: int = 60
    longest: float = 2.0
    threads: int = 0

    def __post_init__(self):
        unknown = [name for name in self.models if name not in MODELS]
        if unknown:
            raise UsageError(
                f"model {unknown[0]!r}",
                expected=f"some of {', '.join(MODELS)}",
                do="choose from these; simulators are named by --with",
            )
        many = len({*self.models}) + len({*self.simulators})
        if many < 2:
            raise UsageError(
                f"{many} to compare",
                expected="two models or simulators, or more",
                do="name more with --models and --with",
            )
        for name, value, least in (("starts", self.starts, 1), ("generations", self.generations, 1)):
            if value < least:
                raise UsageError(f"{name} = {value}", expected=f"{least} or more", do="give another number")
        if not self.longest > 0:
            raise UsageError(
                f"longest = {self.longest:g} s", expected="a time above 0 s", do="give another number"
            )


def compare(
    registry: Registry,
    robot: Robot,
    recording: Recording,
    settings: Settings,
    *,
    name: str,
    progress: Progress | None = None,
) -> Comparison:
    """Make the models, replay the simulators, and compare them on the commands that no model was made from.

    Raises RobotError where the robot has no wheels, LogError where the recording holds no commands, no pose or too few
    commands, NoMatchError where the registry lacks a simulator, SimulationError where one diverges.
    """
    began = time.perf_counter()
    chosen = simulators(registry, robot, settings.simulators, recording.id)
    found = told(robot, recording, longest=settings.longest)
    fit, validation, test = parts(len(found.commands))
    models = tuple(dict.fromkeys(settings.models))
    _require_enough(found, fit, models, len(chosen))
    making = Making(
        found, fit, validation, settings.seed, settings.starts, settings.generations, settings.threads
    )
    shown: list[Contender] = []
    contenders: dict[str, Predicts] = {}
    for number, one in enumerate(chosen):  # first: they are quick, and may have nothing to say
        contenders[one.shown.name] = replayed(
            one.robot, one.config, one.shown.name, recording, found, threads=settings.threads
        )
        shown.append(one.shown)
        if progress:
            progress("replay", number + 1, len(chosen))
    for model in models:
        told_of, contenders[model] = made(model, making, progress)
        shown.append(told_of)
    which = np.arange(test.start, test.stop)
    errors = compared(found.moved[which], {n: c.moved(which) for n, c in contenders.items()})
    ten = runs(found, test.start)
    return Comparison(
        robot=robot.name,
        recording=recording.id,
        recording_name=name,
        parts={"fit": fit.stop, "validation": validation.stop - fit.stop, "test": len(which)},
        track=found.track,
        longest=settings.longest,
        seed=settings.seed,
        starts=settings.starts,
        generations=settings.generations,
        contenders=tuple(shown),
        best=_best(errors),
        errors=errors,
        paths=ends(found, contenders, ten),
        driven=driven(found, recording, pose_names(robot, recording.names), contenders, ten),
        paces=paces(found, contenders, which),
        notes=(*_seen(chosen, recording, found.episode[which]), *_notes(found, ten)),
        cost=Cost(evaluations=0, rollouts=len(chosen), seconds=time.perf_counter() - began),
    )


def parts(many: int) -> tuple[slice, slice, slice]:
    """Commands to fit, to validate and to test, of so many in time; LogError where that leaves too few to test."""
    first, second = (round(many * end / CUT[-1]) for end in CUT[:2])
    if min(second - first, many - second) < LEAST:
        raise LogError(
            f"the recording holds {many} commands, {many - second} of them to test on",
            expected=f"at least {-(-LEAST * CUT[-1] // (CUT[-1] - CUT[1]))}",
            do="record more, or cut held commands into shorter ones with --longest",
        )
    return slice(0, first), slice(first, second), slice(second, many)


def _require_enough(found: Told, fit: slice, models: tuple[str, ...], simulators: int) -> None:
    """LogError where a model cannot be made from what there is to fit; so many simulators are compared beside."""
    learned = [name for name in models if MODELS[name].least]
    short = [name for name in learned if MODELS[name].least > fit.stop]
    if short:
        need = MODELS[short[0]].least
        raise LogError(
            f"{fit.stop} of {len(found.commands)} commands are there to fit model {short[0]!r}",
            expected=f"at least {need}, which takes {-(-need * CUT[-1] // CUT[0])} in all",
            do=f"record more, or leave it out: {_asked([n for n in models if n not in short], simulators)}",
        )
    still = [axis for axis, size in zip(AXES, np.ptp(found.moved[fit], axis=0), strict=True) if size < STILL]
    if learned and still:
        raise LogError(
            f"no two of the {fit.stop} commands to fit differ in {still[0]}",
            expected="commands that drive and turn in several ways",
            do=f"record others, or compare without fitted models: {_asked(['kinematic'], simulators)}",
        )


def _asked(models: list[str], simulators: int) -> str:
    """Options that name these models beside so many simulators, and at least two to compare."""
    named = models or ["kinematic"]
    return f"--models {','.join(named)}" + (" --with nominal" if len(named) + simulators < 2 else "")


def _best(errors: Errors) -> str:
    """The model with the least error as a share of the displacements, over all axes."""
    size = errors.displacements
    share = {
        name: sum(spread.mean / size[axis] for axis, spread in axes.items() if size[axis] > 0)
        for name, axes in errors.models.items()
    }
    return min(share, key=share.__getitem__)


def _seen(chosen: tuple[Simulator, ...], recording: Recording, test: np.ndarray) -> tuple[str, ...]:
    """Which simulators were fitted to episodes that hold commands to test, and to how many of these (m,) episodes."""
    out = []
    names = np.array([e.name for e in recording.episodes])[test]
    for one in chosen:
        if one.fitted_to is None:
            out.append(
                f"{one.shown.name} was fitted to this recording, and nothing says to which part: it may have seen the"
                " commands to test, which models made here have not"
            )
        elif many := int(np.isin(names, sorted(one.fitted_to)).sum()):
            out.append(
                f"{one.shown.name} was fitted to episodes of this recording that hold {many} of the {len(test)}"
                " commands to test: it may have seen them, which models made here have not"
            )
    return tuple(out)


def _notes(found: Told, ten: np.ndarray) -> tuple[str, ...]:
    out = []
    if found.left_out:
        out.append(f"commands left out, at whose begin or end no pose was measured: {found.left_out}")
    if found.on_the_way:
        out.append(
            "first commands of episodes left out, because the robot seems to move before them, at speeds that nobody"
            f" knows: {found.on_the_way}"
        )
    usual = float(np.median(found.commands.seconds))
    if usual < SHORT:
        out.append(
            f"half of the commands last {usual:.2g} s or less: what is left of earlier ones than the last is"
            " in no model made here, and ten of them are a short way"
        )
    if not len(ten):
        out.append("the test part has no ten commands in a row without a gap: no paths are compared")
    return tuple(out)

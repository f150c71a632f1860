"""Models and simulators of a wheeled robot on one recording of it: errors and tests, times, paths (Pretorius et al.).

The commands of a recording, in the order of its episodes, are cut into 1000 to fit, 230 to validate and 230 to test of
each 1460. What a diagnosis or a query held out is a part of its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.compare.contenders import MODELS, Making, Plan, Predicts, made
from dynreg.compare.paces import Pace, paces
from dynreg.compare.paths import DrivenPath, Paths, driven, ends, runs
from dynreg.compare.rollouts import Seen
from dynreg.compare.simulated import replayed
from dynreg.data.recording import Recording
from dynreg.errors import LogError
from dynreg.progress import Progress
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot
from dynreg.timed.commands import AXES
from dynreg.timed.compare import Errors, compared
from dynreg.timed.told import Told, told
from dynreg.timed.wheels import pose_names

CUT = (1000, 1230, 1460)  # ends of the parts to fit, to validate and to test, as published
LEAST = 10  # commands of the last two parts
STILL = 1e-9  # m, rad: a displacement that does not change


@dataclass(frozen=True, eq=False)
class Compared:
    """The answer about a recording's commands: the parts to fit, to validate and to test, and all that was compared.

    contenders : by name, simulators first. paths : None where the test part has no run of commands without a gap.
    """

    told: Told
    parts: tuple[slice, slice, slice]
    contenders: Mapping[str, Predicts]
    errors: Errors
    paths: Paths | None
    driven: tuple[DrivenPath, ...]
    paces: tuple[Pace, ...]


def compare(
    robot: Robot,
    recording: Recording,
    simulators: Mapping[str, tuple[Robot, SimConfig]],
    plan: Plan,
    seen: Mapping[str, Seen],
    progress: Progress | None = None,
) -> Compared:
    """Make the models, replay the simulators (by name, each with its robot), and compare them on the last commands.

    seen : by simulator, what it was fitted to. One that has seen some of the last commands is in no pair, and the best
    only where no other is left.
    Raises RobotError where the robot has no wheels, LogError where the recording holds no commands, no pose or too few
    commands, SimulationError where a simulator diverges.
    """
    found = told(robot, recording, longest=plan.longest)
    fit, validation, test = parts(
        len(found.commands), "record more, or cut held commands into shorter ones with --longest"
    )
    models = tuple(dict.fromkeys(plan.models))
    require_enough(
        found,
        fit,
        models,
        without=lambda left: f"leave it out: {_asked(left, len(simulators))}",
        unfitted=f"compare without fitted models: {_asked(['kinematic'], len(simulators))}",
    )
    contenders: dict[str, Predicts] = {}
    for name, (owner, config) in simulators.items():  # first: they are quick, and may have nothing to say
        contenders[name] = replayed(owner, config, name, recording, found, threads=plan.threads)
        if progress:
            progress("replay", len(contenders), len(simulators))
    making = Making(found, fit, validation, plan)
    contenders |= {name: made(name, making, progress) for name in models}
    which = np.arange(test.start, test.stop)
    ten = runs(found, test.start)
    return Compared(
        told=found,
        parts=(fit, validation, test),
        contenders=contenders,
        errors=compared(
            found.moved[which],
            {n: c.moved(which) for n, c in contenders.items()},
            [name for name, known in seen.items() if _any_seen(found, recording, which, known)],
        ),
        paths=ends(found, contenders, ten),
        driven=driven(found, recording, pose_names(robot, recording.names), contenders, ten),
        paces=paces(found, contenders, which),
    )


def _any_seen(found: Told, recording: Recording, which: np.ndarray, known: Seen) -> bool:
    """Whether one of some commands (indexes) was seen."""
    spans = zip(found.episode[which], found.begin[which], found.end[which], strict=True)
    return any(known(recording.episodes[e].name, float(begin), float(end)) for e, begin, end in spans)


def parts(many: int, do: str = "record more") -> tuple[slice, slice, slice]:
    """Commands to fit, to validate and to test, of so many in time; LogError where that leaves too few to test.

    do : what the error advises.
    """
    first, second = (round(many * end / CUT[-1]) for end in CUT[:2])
    if min(second - first, many - second) < LEAST:
        raise LogError(
            f"the recording holds {many} commands, {many - second} of them to test on",
            expected=f"at least {-(-LEAST * CUT[-1] // (CUT[-1] - CUT[1]))}",
            do=do,
        )
    return slice(0, first), slice(first, second), slice(second, many)


def require_enough(
    found: Told, fit: slice, models: tuple[str, ...], *, without: Callable[[list[str]], str], unfitted: str
) -> None:
    """LogError where a model cannot be made from what there is to fit.

    without : what to do instead, told the models that can be made. unfitted : how to do without fitted models.
    """
    learned = [name for name in models if MODELS[name].least]
    short = [name for name in learned if MODELS[name].least > fit.stop]
    if short:
        need = MODELS[short[0]].least
        raise LogError(
            f"{fit.stop} of {len(found.commands)} commands are there to fit model {short[0]!r}",
            expected=f"at least {need}, which takes {-(-need * CUT[-1] // CUT[0])} in all",
            do=f"record more, or {without([n for n in models if n not in short])}",
        )
    still = [axis for axis, size in zip(AXES, np.ptp(found.moved[fit], axis=0), strict=True) if size < STILL]
    if learned and still:
        raise LogError(
            f"no two of the {fit.stop} commands to fit differ in {still[0]}",
            expected="commands that drive and turn in several ways",
            do=f"record others, or {unfitted}",
        )


def _asked(models: list[str], simulators: int) -> str:
    """Options that name these models beside so many simulators, and at least two to compare."""
    named = models or ["kinematic"]
    return f"--models {','.join(named)}" + (" --with nominal" if len(named) + simulators < 2 else "")

"""The next gait of trials on a robot: what the trials before tell of where it is sought."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dynreg.errors import Assumed, CorruptError, LogError, NoMatchError, UsageError
from dynreg.gait.had import Had
from dynreg.progress import Progress
from dynreg.verbs.gait import GaitSettings, gait

if TYPE_CHECKING:
    from dynreg.gait.tasks import Task
    from dynreg.results.gait import Gait
    from dynreg.sim.robot import Robot
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class Tried:
    """A gait that the robot has had, and what it did there: the fitness that it reached, and whether it fell."""

    gait: "Gait"
    reached: float
    fell: bool


def had_by(robot: "Robot", task: "Task", tried: Sequence[Tried]) -> Had:
    """What the next search is told of the gaits that the robot has had."""
    from dynreg.gait.space import gait_space
    from dynreg.verbs.gaits import genes_of

    space = gait_space(robot, task.motion)
    return Had(
        genes=tuple(tuple(space.from_dict(genes_of(one.gait)).tolist()) for one in tried),
        reached=tuple(one.reached for one in tried),
        walked=tuple(not one.fell and one.reached >= task.success for one in tried),
        simulators=tuple(trial.simulator for one in tried for trial in one.gait.trials),
    )


def forecasts(
    asked: "Recorded", task: "Task", tried: Sequence[Tried], threads: int
) -> tuple[float, ...] | tuple[None, ...]:
    """The fitness to expect of another trial of each gait, by all trials, in the simulators of the last gait.

    None of each where the registry lacks these, as with a folder of trials that another registry began. asked : the
    recording that told them.
    """
    from dynreg.gait.forecast import forecast
    from dynreg.rng import stream_seed
    from dynreg.verbs.gait_simulators import simulators_named, trials_in

    if not tried:
        return ()
    last = tried[-1].gait
    try:
        simulators = simulators_named(asked, [one.simulator for one in last.trials])
    except NoMatchError:
        return (None,) * len(tried)
    seed = stream_seed(last.seed, "after the trials") % 2**31  # draws by which no gait was chosen
    trials = trials_in(asked, task, simulators, seed=seed, threads=threads)
    return (*forecast(trials, had_by(asked.robot, task, tried)).values.tolist(),)


def next_gait(
    last: "Recorded", before: "Recorded", settings: GaitSettings, had: Had, progress: Progress | None
) -> "Gait":
    """The gait by the last recording or, where that does not tell in which simulators to seek, by the one before.

    An interrupted search goes on. Raises as `gait`.
    """
    try:
        return _gone_on(last, settings, had, progress)
    except (NoMatchError, LogError):
        if before is last:
            raise
    return _gone_on(before, settings, had, progress)


def _gone_on(asked: "Recorded", settings: GaitSettings, had: Had, progress: Progress | None) -> "Gait":
    """The gait by a recording; a search whose journal cannot be gone on with begins anew, with a warning."""
    try:
        return gait(asked, replace(settings, resume=True), progress, had=had)
    except CorruptError as error:
        warnings.warn(f"{error.problem}: the search begins anew", Assumed, 2)
    return gait(asked, replace(settings, resume=False), progress, had=had)


def told_by(
    found: "Gait", number: int, settings: GaitSettings, task: "Task", asked: "tuple[Recorded, ...]"
) -> "Recorded":
    """The recording that told the simulators of a gait; UsageError where a kept one was sought otherwise."""
    robot = asked[0].robot
    if found.robot_hash != robot.hash:
        raise UsageError(
            f"the gait of trial {number} was sought for another version of the robot, {found.robot_hash[:12]}",
            expected=f"{robot.name} {robot.hash[:12]}, as this command says",
            do="name the folder of that version, or another folder for the trials",
        )
    own = {"task": task.name, "on": settings.on, "method": settings.method}
    own |= {"accept": settings.search(1).accept, "seed": settings.seed}
    for name, value in own.items():
        if (was := getattr(found, name)) != value:
            raise UsageError(
                f"the gait of trial {number} was sought with {name} {was}",
                expected=f"{value}, as this command says",
                do="give the settings of the first start, or name another folder for the trials",
            )
    told = {one.recording.id: one for one in reversed(asked)}
    if found.recording not in told:
        names = " or ".join(f"{one.name!r} ({identity[:12]})" for identity, one in told.items())
        raise UsageError(
            f"the gait of trial {number} was sought for recording {found.recording[:12]}",
            expected=names,
            do="name a folder of its own for the trials of each recording",
        )
    return told[found.recording]

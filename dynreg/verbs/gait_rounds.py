"""Gaits tried on a robot in turn: the trials' logs tell in which simulators the next gait is sought."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

from dynreg.errors import BudgetError, LogError, UsageError
from dynreg.progress import Progress
from dynreg.verbs.gait import GaitSettings
from dynreg.verbs.next_gait import Tried, forecasts, had_by, next_gait, told_by
from dynreg.verbs.settings import option
from dynreg.verbs.simulator import QUERIED

if TYPE_CHECKING:
    from dynreg.gait.tasks import Task
    from dynreg.results.gait import Gait
    from dynreg.results.gait_rounds import GaitRound, GaitRounds
    from dynreg.sim.real import RealRobot, RealTrial
    from dynreg.verbs.subjects import Recorded

Kept = Callable[
    [int, Callable[[], "Gait"]], "Gait"
]  # the gait of a round, by its number, or the one sought now
TRIALS = 3


@dataclass(frozen=True)
class GaitRoundsSettings(GaitSettings):
    """The settings of `gait_rounds`: those of each search, and what the trials may cost."""

    trials: int | None = option(None, "With --trial: most trials on the robot.", usual=f"{TRIALS}", least=1)
    falls: int | None = option(None, "With --trial: end after this many falls.", usual="never", least=1)

    @property
    def each(self) -> GaitSettings:
        """The settings of one search."""
        return GaitSettings(**{one.name: getattr(self, one.name) for one in fields(GaitSettings)})


def gait_rounds(
    asked: "Recorded",
    settings: GaitRoundsSettings,
    real: "RealRobot",
    progress: Progress | None = None,
    kept: Kept | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> "GaitRounds":
    """Seek a gait, try it on the robot, ask the query again by the trial's log, and so on until the budget is spent.

    While none has walked, each search first tries the gaits that the robot has had. Once one has, and the method can, a
    search stays near the best; where simulators take turns, another one is of the whole range, and the robot gets the
    gait that should do more (`forecast.new_does_more`). An interrupted search goes on.

    The best gait is the one that should do most in another trial (`forecast.forecast`), of those that stood.

    Every trial's log is registered, as "NAME trial N". Where it does not tell in which simulators to seek (none is
    close enough, or it is too short), the next gait is sought in those of the round before.

    kept : gives the gait of a round, by its number, instead of the one that a call would seek; see `TrialFolder`. It
    also says that a second call goes on. Without it, what the trials brought is stored even where an error ends them.
    say : tells what a gait may bring, and what it brought.
    Raises as `gait` and `real.run` do, but for BudgetError, which ends the trials. Raises UsageError where the
    simulators do not come from a query, a kept gait was sought otherwise or no trial on the robot can tell what the
    task scores, LogError where a log does not tell it.
    """
    from dynreg.gait.play import commands, require_playable
    from dynreg.gait.tasks import task_of
    from dynreg.rng import stream_seed

    require_query(settings.on)
    task, rounds, tried = task_of(asked.robot, settings.task), [], []
    _require_seen(task, real)
    by = last = asked
    ended, before = "the budget of trials", real.spent.seconds
    document = lambda ended: _document(asked, task, rounds, real.spent.seconds - before, ended)  # noqa: E731
    with nullcontext() if kept else _stored_if_interrupted(asked, rounds, document):
        try:
            for number in range(1, (settings.trials or TRIALS) + 1):
                if settings.falls and sum(one.fell for one in rounds) >= settings.falls:
                    ended = f"{settings.falls} falls"
                    break
                real.afford(task.seconds)  # before time is spent on a gait
                seed = stream_seed(settings.seed, "gait round", number) % 2**31 if rounds else settings.seed
                each = replace(settings.each, seed=seed)
                sought = partial(next_gait, last, by, each, had_by(asked.robot, task, tried), progress)
                found = kept(number, sought) if kept else sought()
                by = told_by(found, number, each, task, (last, by))
                require_playable(found)
                say(f"trial {number}: {found.prediction}")
                trial = real.run(commands(found)[1], found.rate, f"trial_{number}")
                fits, last = by is last, _registered(asked, found, number, trial)
                tried.append(Tried(found, _fitness(task, trial), trial.fell))
                rounds.append(_round(tried[-1], fits, last))
                say(f"trial {number}: {rounds[-1].outcome(task.unit)}; its log is {last.name!r}")
        except BudgetError as spent:
            ended = spent.problem
        again = forecasts(by, task, tried, settings.threads)
    rounds = [one.model_copy(update={"again": v}) for one, v in zip(rounds, again, strict=True)]
    return document(ended)


@contextmanager
def _stored_if_interrupted(
    asked: "Recorded", rounds: "list[GaitRound]", document: "Callable[[str], GaitRounds]"
) -> Iterator[None]:
    """Store what the trials brought, where an error or Ctrl-C ends them: nobody can have them again."""
    try:
        yield
    except BaseException:
        if rounds:
            asked.keep(document(f"interrupted after trial {len(rounds)}"))
        raise


def _fitness(task: "Task", trial: "RealTrial") -> float:
    """What a trial reached; LogError where its log does not tell."""
    from dynreg.gait.tasks import fitness

    reached = float(fitness(task.grade(trial.walk))[0, 0])
    if not math.isfinite(reached):
        raise LogError(
            f"the log does not tell the fitness of task {task.name!r}: it is {reached}",
            expected="a log with all that the task scores",
            do="log the base's velocities too, or choose another task",
        )
    return reached


def _require_seen(task: "Task", real: "RealRobot") -> None:
    """UsageError where a task scores bodies beside the robot, and trials on the robot do not tell where they went."""
    if task.bodies and not real.tracks:
        raise UsageError(
            f"task {task.name!r} scores where a body beside the robot goes, which no log of a trial tells",
            expected="a task that the motion of the base alone scores, or a RealRobot whose trials see that body",
            do="seek one gait without trials and score it by hand, or choose another task",
        )


def require_query(on: str) -> None:
    """UsageError where a word names simulators that no query of a trial's log can name anew."""
    if on not in QUERIED:
        raise UsageError(
            f"trials on the robot with --on {on}",
            expected=f"one of {', '.join(QUERIED)}: a query of each trial's log names the next simulators",
            do="choose one of them, or seek one gait without trials",
        )


def _registered(asked: "Recorded", found: "Gait", number: int, trial: "RealTrial") -> "Recorded":
    """The log of a trial, registered with its gait before anybody judges it."""
    from dynreg.verbs.ingest import ingest

    registry = asked.registry
    identity = registry.put_result(found.schema_name(), found.recording, found.to_dict())
    # trials of an earlier call have some of the names
    numbers = (f"{asked.name} trial {i}" for i in count(number))
    name = next(name for name in numbers if registry.may_be_called(trial.recording, name))
    log = ingest(registry, trial.recording, asked.robot, name=name, gait=identity)
    return replace(asked, recording=registry.recording(log.recording), name=name)


def _round(tried: Tried, fits: bool, log: "Recorded") -> "GaitRound":
    """What is told of a trial, of which gait and log are registered."""
    from dynreg.results.gait_rounds import GaitRound

    found = tried.gait
    return GaitRound(
        gait=log.recording.provenance["gait"],
        simulators=tuple(one.simulator for one in found.trials),
        told_by=found.recording,
        fits=fits,
        median=found.expected.median,
        p5=found.expected.p5,
        p95=found.expected.p95,
        recording=log.recording.id,
        name=log.name,
        packaged=found.packaged,
        fitness=tried.reached,
        fell=tried.fell,
    )


def _document(
    asked: "Recorded", task: "Task", rounds: "list[GaitRound]", seconds: float, ended: str
) -> "GaitRounds":
    from dynreg.results.gait_rounds import GaitRounds

    stood = [i for i, one in enumerate(rounds) if not one.fell]
    best = max(stood, key=lambda i: rounds[i].worth, default=None)
    return GaitRounds(
        robot=asked.robot.name,
        recording=asked.recording.id,
        recording_name=asked.name,
        task=task.name,
        unit=task.unit,
        rounds=tuple(rounds),
        best=None if best is None else best + 1,
        seconds=seconds,
        ended=ended,
    )

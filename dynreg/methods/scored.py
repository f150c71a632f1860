"""A robot of which a trial tells one number: how well it did its task, or that it fell."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from dynreg.adapt.journalled import Outcome, trial_name
from dynreg.adapt.tried import Rules
from dynreg.data.recording import Recording
from dynreg.errors import LogError, UsageError
from dynreg.gait.logged import trial_of
from dynreg.gait.tasks import Task, fitness
from dynreg.sim.real import Door, RealRobot, RealTrial
from dynreg.sim.robot import Robot

Player = Callable[[np.ndarray, float, str], Recording | float | str | None]
FELL = "fell"  # what a function may return for a fall, beside None, and what the file of a score says


@dataclass
class ScoredRobot(Door):
    """A robot to be tried for a task, for a price.

    real : a `RealRobot`, whose own budget holds, too; or a function that is called with commands (T, A), how many a
    second and the trial's name. It plays them, and returns the log, the score in the task's unit, or for a fall None or
    `FELL`. Where it has `keeps` = True, it plays no trial of a name twice, and gives what the first one left.
    Raises UsageError where no log can tell what the task scores, and for a `RealRobot` with other commands.
    """

    robot: Robot
    task: Task
    real: RealRobot | Player

    def __post_init__(self) -> None:
        if isinstance(self.real, RealRobot) and self.real.robot.actions != self.robot.actions:
            raise UsageError(
                f"a robot to try with the commands {', '.join(self.real.robot.actions)}",
                expected=f"those of {self.robot.name!r}: {', '.join(self.robot.actions)}",
                do="give the robot that the gait is for",
            )
        if self.task.bodies and isinstance(self.real, RealRobot) and not self.real.tracks:
            raise UsageError(
                f"task {self.task.name!r} scores where a body beside the robot goes, which no log of a trial tells",
                expected="a score of each trial, or a task that the motion of the base alone scores",
                do="measure it by hand and give the score, or choose another task",
            )

    @property
    def name(self) -> str:
        return self.robot.name

    @property
    def keeps(self) -> bool:
        """Whether a trial whose outcome was lost can be asked for again, and moves nothing."""
        return bool(getattr(self.real, "keeps", False))

    @property
    def _doors(self) -> tuple[Door, ...]:
        """All that count: the last counts what was tried before this run, too."""
        return (self, self.real) if isinstance(self.real, RealRobot) else (self,)

    def begin(self, seconds: float) -> Outcome:
        """What the next trial counts for if nothing tells how it ends; BudgetError where a budget does not allow it."""
        for door in self._doors:
            door.afford(seconds)
        number, ever = (door.spent.trials + 1 for door in (self, self._doors[-1]))
        return Outcome(None, seconds, number, ever, lost=True)

    def try_out(self, actions: np.ndarray, rate: float) -> Outcome:
        """Play commands (T, A), `rate` a second; a trial that ends with an error counts, too.

        Raises BudgetError before anything moves where a budget is spent, LogError for an answer that tells no score.
        """
        begun = self.begin(len(actions) / rate)
        play = self.real.run if isinstance(self.real, RealRobot) else self.real
        try:
            found = play(actions, rate, trial_name(begun.number))
            trial = trial_of(self.robot, found, actions, rate) if isinstance(found, Recording) else found
            score = score_of(self.task, trial)
        except BaseException:
            self.spend(begun.seconds)
            raise
        seconds = trial.lasted(len(actions)) / rate if isinstance(trial, RealTrial) else begun.seconds
        self.spend(seconds, falls=int(score is None))
        return replace(begun, score=score, seconds=seconds, lost=False)

    def again(self, outcome: Outcome) -> None:
        """Count a trial of an interrupted run, on a robot that does not know of it, too.

        Raises UsageError where a folder has another answer to it by now.
        """
        if require_same := getattr(self.real, "require_same", None):
            require_same(trial_name(outcome.number), outcome.score)
        self.spend(outcome.seconds, falls=int(outcome.fell))
        if isinstance(self.real, RealRobot) and self.real.spent.trials < outcome.ever:
            self.real.spend(outcome.seconds, falls=int(outcome.fell))


def score_of(task: Task, trial: Any) -> float | None:
    """The score that a trial tells, in the task's unit, None for a fall; LogError where it tells none."""
    if isinstance(trial, RealTrial):
        score = None if trial.fell else float(fitness(task.grade(trial.walk))[0, 0])
    elif trial is None or (isinstance(trial, str) and trial.strip().lower() == FELL):
        score = None
    elif isinstance(trial, Real) and not isinstance(trial, bool | np.bool_):
        score = float(trial)
    else:
        raise LogError(
            f"a trial of task {task.name!r} came to {trial!r:.60}",
            expected=f"a log, a number, or None or {FELL!r} for a fall",
            do="return one of these from the function that plays commands",
        )
    if score is not None and not math.isfinite(score):
        raise LogError(
            f"a trial of task {task.name!r} has the score {score}",
            expected="a log with all that the task scores, or a finite number",
            do="log the base's velocities too, or measure the score by hand",
        )
    return score


@dataclass(frozen=True, eq=False)
class Trying:
    """A robot that is tried, gaits (n, G) to begin with, of which any may be known to stand, and how.

    rules : None for the published sizes. goes_on : whether there are trials of an interrupted run.
    """

    robot: ScoredRobot
    gaits: np.ndarray
    rules: Rules | None = None
    goes_on: bool = False

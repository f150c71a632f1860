"""Calibrate by trials: a simulator and a gait that are made better by what gaits score on the robot."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg.adapt.tried import Rules
from dynreg.errors import RobotError, UsageError
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task, task_of
from dynreg.methods.by_reality import rows_of
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.scored import Player, ScoredRobot, Trying
from dynreg.methods.table import METHODS
from dynreg.progress import Progress
from dynreg.registry import Registry
from dynreg.results.calibration import Calibration
from dynreg.sim.config import SimConfig
from dynreg.sim.real import Budget, RealRobot
from dynreg.sim.robot import Robot
from dynreg.verbs.arguments import require
from dynreg.verbs.best_gait import best_gait
from dynreg.verbs.calibrate import TRIALS, stored_answer, unfit
from dynreg.verbs.calibration import register
from dynreg.verbs.calibration_start import begun_with, values_of
from dynreg.verbs.gaits import gait_of, genes_of
from dynreg.verbs.journals import Journals
from dynreg.verbs.robot_door import door_of, place_of, require_recording, robot_to_try
from dynreg.verbs.subjects import put_robot
from dynreg.verbs.trials_document import cost_of, document
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings

KEPT = "trials"  # the journal of them,
NUMBER = 3  # and where a row of it has a trial's number; see `Journalled`


def calibrate_by_trials(
    registry: Registry,
    subject: str | Path | Robot,
    settings: "CalibrateSettings",
    progress: Progress | None = None,
    *,
    robot_door: str | Path | RealRobot | Player | None,
    gait: str | Path | Mapping[str, float] | None = None,
    rules: Rules | None = None,
    log_map: str | Path | None = None,
    say: Callable[[str], None] = print,
) -> Calibration:
    """Adapt a simulator and a gait to a robot by the scores of trials on it; the answer is stored.

    subject : the robot, its folder or its name. robot_door : the robot as it is tried, or a folder for its trials; see
    `Session.calibrate` for it, and for gait, rules and say. log_map : refused where it means nothing.
    Raises BudgetError where the robot's own budget allows no trial, NoMatchError where no gait stood, UsageError for
    arguments that do not fit or allow no trial, and where an interrupted run has left trials and is not resumed.
    """
    began, worked = time.perf_counter(), time.process_time()
    registry.check_writable()
    asked = Built(registry, robot_to_try(registry, subject, settings.method))
    task = _task(asked.robot, settings)  # a mistake here, or in gait and start, makes no folder
    if rules is not None:
        require("rules", rules, Rules)
    rules = rules or Rules()
    told = {name: getattr(settings, name) for name in ("goal", "search")}
    rules = replace(rules, **{name: value for name, value in told.items() if value is not None})
    _require_enough(asked.robot, task, settings, rules)
    gaits = _gaits(registry, asked.robot, task, gait)
    begin = begun_with(registry, settings.start, asked.robot)
    journals = _journals(asked, settings, task, begin and begin.id, gaits, rules, place_of(robot_door))
    key = journals.key_of(trials=settings.trials, seconds=settings.seconds, falls=settings.falls)
    if settings.resume and not journals.begun(KEPT):
        if (ended := stored_answer(registry, None, key)) is not None:
            return ended
    played = door_of(robot_door, registry, asked.robot, task, settings, log_map, say, rules)
    door = ScoredRobot(asked.robot, task, played, budget=_budget(settings))
    left = _left(journals, door)
    trying = Trying(door, gaits, rules, goes_on=left is not None)
    limits = Limits(settings.budget, settings.seed, settings.threads, journals.of, progress)
    with journals.held(KEPT):
        question = Question(None, values_of(begin, asked.robot))
        found = METHODS[settings.method].made().fit(question, Evidence(trying=trying), limits)
        put_robot(registry, asked.robot)
        configs = [SimConfig.of(asked.robot, v.values, v.effects) for v in found.versions]
        origin = {"made_by": f"calibrate {settings.method}", "task": task.name}
        ids = register(registry, found, configs, begin and begin.id, origin)
        stored, gait_made = best_gait(asked, settings, task, found, ids[-1][0])
        cost = cost_of(found, door, gait_made, time.perf_counter() - began, time.process_time() - worked)
        made = document(asked, settings, task, found, ids, cost, stored, rules.difference)
        made = made.model_copy(update={"question": key})
        registry.put_result(made.schema_name(), None, made.to_dict())
        journals.end()
    return made


def _require_enough(robot: Robot, task: Task, settings: "CalibrateSettings", rules: Rules) -> None:
    """UsageError where the budgets allow no trial or not one generation; before a folder is made."""
    rules.within(settings.budget)
    whole = rows_of(robot, task) / robot.rate
    if settings.seconds is not None and settings.seconds < whole:
        raise UsageError(
            f"{settings.seconds:g} s of trials, and one of task {task.name!r} takes {whole:g} s",
            expected="seconds for one trial at least",
            do="raise --seconds, or choose a shorter task",
            setting="seconds",
        )


def _task(robot: Robot, settings: "CalibrateSettings") -> Task:
    """The task of the trials; UsageError where the robot has none, as the method needs one."""
    try:
        return task_of(robot, settings.task)
    except RobotError as error:
        raise UsageError(
            f"method {settings.method!r} needs a task to score: {error.problem}",
            expected=error.expected,
            do=error.do,
        ) from None


def require_recordings(
    registry: Registry, subject: Any, method: str, tries: Mapping[str, Any | None]
) -> None:
    """UsageError where a method that reads recordings is given a robot, or what is only for trials on one.

    tries : {name: argument}.
    """
    for name, value in tries.items():
        if value is not None:
            raise unfit(name, "", method, "trials")
    if not isinstance(subject, list | tuple):
        require_recording(registry, subject, method)


def _left(journals: Journals, door: ScoredRobot) -> list[float] | None:
    """The last trial of an interrupted run, to go on with; None where there is none.

    Raises UsageError where trials would be lost, or be played again: they cannot be had again, as simulations can.
    """
    left = journals.left(KEPT)
    if journals.resume and not (journals.begun(KEPT) or door.keeps):
        raise UsageError(
            "no trials of an interrupted run with these settings are kept",
            expected="a run that was interrupted; one that ended has its result",
            do="give its settings and seed, or leave out --resume to play all trials anew",
        )
    if left is not None and not journals.resume:
        raise UsageError(
            f"the trials of an interrupted run with these settings ({left[NUMBER]:.0f}) would be lost",
            expected="to go on with them, or another seed to begin anew",
            do="give --resume, or another --seed",
        )
    return left


def _journals(
    asked: Built,
    settings: "CalibrateSettings",
    task: Task,
    begin: str | None,
    gaits: np.ndarray,
    rules: Rules,
    place: str,
) -> Journals:
    """The journals of this question. place : which robot is tried."""
    question = {"calibrate": settings.method, "robot": asked.robot.hash, "task": task.name}
    how = {
        "seed": settings.seed,
        "start": begin,
        "budget": settings.budget,
        "gait": gaits.tolist(),
        "rules": asdict(rules),
        "trial": place,
    }
    return Journals(asked.registry, question, how, settings.resume, trials=KEPT)


def _budget(settings: "CalibrateSettings") -> Budget:
    trials = TRIALS if settings.trials is None else settings.trials
    return Budget(trials, settings.seconds, settings.falls)


def _gaits(
    registry: Registry, robot: Robot, task: Task, gait: str | Path | Mapping[str, float] | None
) -> np.ndarray:
    """(n, G) genes of the gaits to begin with."""
    space = gait_space(robot, task.motion)
    if gait is None:
        return space.from_unit(space.starts)
    genes = gait if isinstance(gait, Mapping) else genes_of(gait_of(registry, gait))
    found = space.from_dict(genes)
    space.require(found)
    return found[None]

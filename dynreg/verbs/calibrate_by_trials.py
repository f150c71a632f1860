"""Calibrate by trials: a simulator and a gait that are made better by what gaits score on the robot."""

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dynreg.adapt.tried import Rules
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task, task_of
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.scored import ScoredRobot, Trying
from dynreg.methods.table import METHODS
from dynreg.progress import Progress
from dynreg.registry import Registry
from dynreg.results.calibration import Calibration
from dynreg.sim.real import Budget
from dynreg.sim.robot import Robot
from dynreg.verbs.calibration_by_trials import cost_of, document, register
from dynreg.verbs.calibration_start import require_plain, shared_values
from dynreg.verbs.gait_by_trials import gait_by_trials
from dynreg.verbs.gaits import gait_of, genes_of
from dynreg.verbs.journals import Journals
from dynreg.verbs.simulators import NOMINAL, Simulator, simulator
from dynreg.verbs.tryable import Tryable
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings

TRIALS = 190  # as in paper B
TRIALS_KEPT = "trials"  # the journal of them


def calibrate_by_trials(
    asked: Built, settings: "CalibrateSettings", tryable: Tryable, progress: Progress | None = None
) -> Calibration:
    """Adapt a simulator and a gait to a robot by the scores of trials on it.

    Raises BudgetError where not even one trial may be made, NoMatchError where no gait stood, UsageError where an
    interrupted run has left trials and is not resumed.
    """
    began, worked = time.perf_counter(), time.process_time()
    robot, registry = asked.robot, asked.registry
    task = task_of(robot, settings.task)
    begin = _begun_with(asked, settings.start)
    start = None
    if begin is not None:
        start = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | shared_values(begin, robot))
    rules, gaits = tryable.rules or Rules(), _gaits(registry, robot, task, tryable.gait)
    door = ScoredRobot(robot, task, tryable.real, budget=_budget(settings))
    journals = Journals(
        registry,
        {"calibrate": settings.method, "robot": robot.hash, "task": task.name},
        {
            "seed": settings.seed,
            "start": begin and begin.id,
            "budget": settings.budget,
            "gait": gaits.tolist(),
            "rules": asdict(rules),
        },
        settings.resume,
    )
    journals.require_new(TRIALS_KEPT)
    # a run that is continued may have another goal and another budget of trials
    trying = Trying(door, gaits, rules if settings.goal is None else replace(rules, goal=settings.goal))
    limits = Limits(settings.budget, settings.seed, settings.threads, journals.of, progress)
    found = METHODS[settings.method].made().fit(Question(None, start), Evidence(trying=trying), limits)
    ids = register(asked, settings.method, task, found, begin and begin.id)
    gait = gait_by_trials(asked, settings, task, found, ids[-1][0], time.perf_counter() - began)
    cost = cost_of(found, door, time.perf_counter() - began, time.process_time() - worked)
    made = document(asked, settings, task, found, ids, cost, gait)
    registry.put_result(made.schema_name(), None, made.to_dict())
    journals.end()
    return made


def _budget(settings: "CalibrateSettings") -> Budget:
    trials = TRIALS if settings.trials is None else settings.trials
    return Budget(trials, settings.seconds, settings.falls)


def _begun_with(asked: Built, start: str) -> Simulator | None:
    if start == NOMINAL:
        return None
    found = simulator(asked.registry, start, asked.robot)
    require_plain(found, asked.robot)
    return found


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

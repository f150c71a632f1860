"""Calibrate by trials: a simulator and a gait that are made better by what gaits score on the robot."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg.adapt.reality import Rules
from dynreg.errors import NoMatchError, RobotError, UsageError
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task, task_of
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.methods.scored import Played, ScoredRobot, Trying
from dynreg.methods.table import METHODS
from dynreg.progress import Progress
from dynreg.registry import Registry
from dynreg.results.calibration import Calibration, CalibrationCost, CalibrationVersion, OnRobot, TriedGait
from dynreg.sim.config import SimConfig
from dynreg.sim.real import Budget, RealRobot
from dynreg.sim.robot import Robot, packaged_robots
from dynreg.verbs.calibration import parameters
from dynreg.verbs.calibration_start import require_plain, shared_values
from dynreg.verbs.gait_by_trials import gait_by_trials
from dynreg.verbs.gaits import gait_of, genes_of
from dynreg.verbs.journals import Journals
from dynreg.verbs.simulators import NOMINAL, Simulator, simulator
from dynreg.verbs.subjects import loaded_robot, put_robot
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings

TRIALS = 190  # as in paper B


@dataclass(frozen=True)
class Tryable:
    """The robot itself, gaits to begin with, and sizes other than the published ones.

    real : see `ScoredRobot`. gait : a stored gait, {gene: value}, or None for those of the robot's folder.
    """

    real: RealRobot | Played
    gait: str | Path | Mapping[str, float] | None = None
    rules: Rules | None = None


def calibrate_by_trials(
    asked: Built, settings: "CalibrateSettings", tryable: Tryable, progress: Progress | None = None
) -> Calibration:
    """Adapt a simulator and a gait to a robot by the scores of trials on it.

    Raises BudgetError where not even one trial may be made, NoMatchError where no gait stood.
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
    # a run that is continued may have another goal and another budget of trials
    trying = Trying(door, gaits, rules if settings.goal is None else replace(rules, goal=settings.goal))
    limits = Limits(settings.budget, settings.seed, settings.threads, journals.of, progress)
    found = METHODS[settings.method].made().fit(Question(None, start), Evidence(trying=trying), limits)
    ids = _register(asked, settings.method, task, found, begin and begin.id)
    gait = gait_by_trials(asked, settings, task, found, ids[-1][0], time.perf_counter() - began)
    cost = _cost(found, door, time.perf_counter() - began, time.process_time() - worked)
    made = _document(asked, settings, task, found, ids, cost, gait)
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


def _register(
    asked: Built, method: str, task: Task, found: Answer, begin: str | None
) -> list[tuple[str, str | None]]:
    """(id, parent's id) of each version's simulator, registered with the trials that shaped it."""
    put_robot(asked.registry, asked.robot)
    out: list[tuple[str, str | None]] = []
    for version in found.versions:
        parent = begin if version.parent is None else out[version.parent][0]
        lineage: dict[str, Any] = {
            "made_by": f"calibrate {method}",
            "stage": version.stage,
            "task": task.name,
        }
        lineage |= {"trials": list(version.trials)} if version.trials else {}
        lineage |= {} if parent is None else {"parent": parent}
        config = SimConfig.of(asked.robot, version.values, version.effects)
        out.append((asked.registry.put_simulator(config.as_dict() | {"lineage": lineage}), parent))
    return out


def _cost(found: Answer, door: ScoredRobot, seconds: float, core_seconds: float) -> CalibrationCost:
    return CalibrationCost(
        evaluations=0,
        rollouts=found.rollouts,
        resumed=found.resumed,
        seconds=seconds,
        simulated_seconds=found.simulated,
        core_seconds=core_seconds,
        trials=door.spent.trials,
        trial_seconds=door.spent.seconds,
        falls=door.spent.falls,
        discarded=sum(len(one.trials) for one in found.tried if one.fell),
    )


def _document(
    asked: Built,
    settings: "CalibrateSettings",
    task: Task,
    found: Answer,
    ids: list[tuple[str, str | None]],
    cost: CalibrationCost,
    gait: str,
) -> Calibration:
    return Calibration(
        robot=asked.robot.name,
        recording=None,
        method=settings.method,
        simulator=ids[-1][0],
        versions=tuple(_version(one, *told) for one, told in zip(found.versions, ids, strict=True)),
        parameters=parameters(asked.robot, found),
        train_error=None,
        test_error=None,
        nominal_train_error=None,
        nominal_test_error=None,
        history=(),
        ended=found.ended,
        seed=settings.seed,
        on_robot=_on_robot(asked.robot, task, found, gait),
        cost=cost,
    )


def _version(version: Version, simulator: str, parent: str | None) -> CalibrationVersion:
    return CalibrationVersion(
        simulator=simulator,
        stage=version.stage,
        parent=parent,
        recordings=(),
        episodes=(),
        before=version.before,
        after=version.after,
        trials=version.trials,
    )


def _on_robot(robot: Robot, task: Task, found: Answer, gait: str) -> OnRobot:
    stood = [i for i, one in enumerate(found.tried) if not one.fell]
    return OnRobot(
        task=task.name,
        unit=task.unit,
        seconds=task.seconds,
        tried=tuple(
            TriedGait(
                iteration=one.iteration,
                step=one.step,
                trials=one.trials,
                scores=one.scores,
                simulated=one.simulated,
            )
            for one in found.tried
        ),
        best=1 + max(stood, key=lambda i: found.tried[i].score),
        gait=gait_space(robot, task.motion).as_dict(found.gait),
        document=gait,
    )


def robot_to_try(registry: Registry, subject: Any, method: str) -> Robot:
    """The robot that a method tries; UsageError where a recording or a log is given instead."""
    try:
        if isinstance(subject, str | Path | Robot):
            return loaded_robot(subject, registry=registry)
    except RobotError:
        if not (_is_recording(registry, subject) or Path(subject).is_file()):
            raise
    raise UsageError(
        f"method {method!r} tries a robot, and reads no recording such as {str(subject)!r}",
        expected="a robot: a packaged name or a folder",
        do="name the robot, or choose another method for the recording",
    )


def require_recording(registry: Registry, subject: Any, method: str) -> None:
    """UsageError where a robot is given to a method that reads a recording."""
    own = isinstance(subject, str | Path) and (
        str(subject) in packaged_robots() or (Path(subject) / "robot.toml").is_file()
    )
    if isinstance(subject, Robot) or (own and not _is_recording(registry, subject)):
        name = subject.name if isinstance(subject, Robot) else str(subject)
        raise UsageError(
            f"method {method!r} needs a recording, and {name!r} is a robot",
            expected="a registered recording, or a log with --robot",
            do="name one, or try gaits on the robot with --method btr",
        )


def _is_recording(registry: Registry, ref: Any) -> bool:
    try:
        return registry.resolve(str(ref), ("recording",))[0] == "recording"
    except NoMatchError:
        return False


def real_of(
    real: Any, registry: Registry, robot: Robot, log_map: Any, say: Callable[[str], None], method: str
) -> RealRobot | Played:
    """The robot as it is tried: itself, a function, or a folder for its trials. Raises UsageError for anything else."""
    from dynreg.data.maps import read_map
    from dynreg.verbs.trial_folder import TrialFolder, folder_of

    if isinstance(real, str | Path):
        given = None if log_map is None else read_map(log_map)
        return TrialFolder(folder_of(real), registry, robot, given, say).told
    if isinstance(real, RealRobot) or callable(real):
        return real
    raise UsageError(
        f"method {method!r} without a robot to try"
        if real is None
        else f"a robot of type {type(real).__name__!r}",
        expected="a folder for its trials; in Python also a RealRobot, or a function that plays commands",
        do="name a folder with --trial, or give `robot_door` in Python",
    )

"""The document of a calibration by trials: the simulators on the way, registered, and what the robot did."""

from typing import TYPE_CHECKING, Any

from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task
from dynreg.methods.answer import Answer, Version
from dynreg.methods.scored import ScoredRobot
from dynreg.results.calibration import Calibration, CalibrationCost, CalibrationVersion, OnRobot, TriedGait
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot
from dynreg.verbs.calibration import parameters
from dynreg.verbs.subjects import put_robot
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings


def register(
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


def cost_of(found: Answer, door: ScoredRobot, seconds: float, core_seconds: float) -> CalibrationCost:
    """What it cost, on the robot too. seconds, core_seconds : of this run."""
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


def document(
    asked: Built,
    settings: "CalibrateSettings",
    task: Task,
    found: Answer,
    ids: list[tuple[str, str | None]],
    cost: CalibrationCost,
    gait: str,
) -> Calibration:
    """The document. ids : see `register`. gait : id of the stored gait."""
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
        best=1 + found.tried.index(found.best),
        gait=gait_space(robot, task.motion).as_dict(found.gait),
        document=gait,
    )

"""The document of a calibration by trials: its simulators, what the robot did, and what it cost."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task
from dynreg.methods.answer import Answer
from dynreg.methods.scored import ScoredRobot
from dynreg.results.calibration import Calibration, CalibrationCost, OnRobot, TriedGait
from dynreg.results.gait import Gait
from dynreg.sim.robot import Robot
from dynreg.verbs.calibration import parameters, versions
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings


def cost_of(
    found: Answer, door: ScoredRobot, gait: Gait, seconds: float, core_seconds: float
) -> CalibrationCost:
    """What it cost, on the robot too, and the runs of the stored gait. seconds, core_seconds : of this run."""
    runs = gait.cost.rollouts
    return CalibrationCost(
        evaluations=0,
        rollouts=found.rollouts + runs,
        resumed=found.resumed,
        seconds=seconds,
        simulated_seconds=found.simulated + runs * gait.seconds,
        core_seconds=core_seconds,
        trials=door.spent.trials,
        trial_seconds=door.spent.seconds,
        falls=door.spent.falls,
        discarded=sum(len(one.trials) for one in found.tried if one.fell),
        lost=door.spent.trials - sum(len(one.trials) for one in found.tried),
    )


def document(
    asked: Built,
    settings: "CalibrateSettings",
    task: Task,
    found: Answer,
    ids: Sequence[tuple[str, str | None]],
    cost: CalibrationCost,
    gait: str,
    difference: str,
) -> Calibration:
    """The document. ids : see `calibration.register`. gait : id of the stored gait. difference : of the rules."""
    return Calibration(
        robot=asked.robot.name,
        recording=None,
        method=settings.method,
        simulator=ids[-1][0],
        versions=versions(found, ids),
        parameters=parameters(asked.robot, found),
        train_error=None,
        test_error=None,
        nominal_train_error=None,
        nominal_test_error=None,
        history=(),
        ended=found.ended,
        seed=settings.seed,
        on_robot=_on_robot(asked.robot, task, found, gait, difference),
        cost=cost,
    )


def _on_robot(robot: Robot, task: Task, found: Answer, gait: str, difference: str) -> OnRobot:
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
        difference=difference,
    )

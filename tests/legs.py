"""A leg in the air, and one over the stop of its rail, as problems: one second to fit, as much to select by."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from dynreg.diagnose.calibrate import Calibrated, calibrate
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.accuracy import rough
from dynreg.evidence.data import Data
from dynreg.evidence.lockstep import run
from dynreg.evidence.model import Model
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

ASKED = DiagnosisOptions(hold_out="test_0", threads=1)


@lru_cache
def in_the_air(key: str | None = None) -> tuple[Model, Data, Hidden]:
    """A leg in the air that hides a strong effect, moved livelily."""
    robot = load_robot("leg")
    table = robot.file.excitation.model_copy(update={"kinds": ["levels", "chirp"]})
    lively = replace(robot, file=robot.file.model_copy(update={"excitation": table}))
    plan = protocol(lively, seed=1, seconds=5.0, episode=1.0, reach=1.0)
    hidden = hide(robot, () if key is None else (term(key),), "strong", 11)
    return *pose(robot, log_of(robot, hidden, plan), ASKED), hidden


@lru_cache
def over_its_stop(height: float) -> tuple[Model, Data, Hidden]:
    """A leg without effects, its rail's stop at `height` [m]: at 0.2 the foot touches the ground."""
    robot = load_robot("leg")
    plan = protocol(robot, seed=1, seconds=5.0, episode=1.0, reach=1.0)
    plan = replace(plan, run=replace(plan.run, settings=np.full_like(plan.run.settings, height)))
    hidden = hide(robot, (), None, 11)
    return *pose(robot, log_of(robot, hidden, plan), ASKED), hidden


@lru_cache
def calibrated(key: str | None, roughly: bool = False) -> Calibrated:
    """The calibrated simulator of the leg in the air; roughly : as if contacts came and went."""
    model, data, _ = in_the_air(key)
    if roughly:
        model = replace(model, accuracy=rough(model.robot))
    return run(calibrate(model, data, draws=0))

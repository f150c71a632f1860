"""The gait that trials on the robot left, as a document that `dynreg export` writes for it."""

from typing import TYPE_CHECKING

import numpy as np

from dynreg.gait.seek import SearchSettings, Sought, expected
from dynreg.gait.tasks import Task, fitness
from dynreg.gait.trials import Trials, simulators_of
from dynreg.methods.answer import Answer
from dynreg.search.drive import Found
from dynreg.verbs.gait_document import document
from dynreg.verbs.gait_simulators import Chosen
from dynreg.verbs.simulators import simulator
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings


def best_gait(
    asked: Built, settings: "CalibrateSettings", task: Task, found: Answer, identity: str, seconds: float
) -> str:
    """Id of the stored gait: the best on the robot, run once more in the last simulator (its id)."""
    robot, registry = asked.robot, asked.registry
    chosen = Chosen("calibrated", ("simulator",), (simulator(registry, identity, robot),))
    simulators = simulators_of(robot, [one.config for one in chosen.simulators])
    told = {"rate": robot.rate, "seed": settings.seed, "threads": settings.threads}
    trials = Trials(robot, task, simulators, **told)
    walk = trials.walk(found.gait[None], feet=True)
    sought = Sought(
        found=Found(
            trials.space.to_unit(found.gait),
            fitness(task.grade(walk)[:, 0]),
            max(one.score for one in found.tried if not one.fell),
            (),
            len(found.tried),
            0,
            found.ended,
        ),
        finals=None,
        packaged=None,
        genes=found.gait,
        fitness=fitness(task.grade(walk)[:, 0]),
        fell=walk.fell[:, 0] < walk.base.shape[2],
        helpless=np.zeros(len(simulators), dtype=bool),
        walk=walk,
    )
    unseen = expected(trials, found.gait)
    search = SearchSettings(seed=settings.seed)
    made = document(robot, (None, ""), chosen, trials, search, sought, unseen, seconds)
    made = made.model_copy(update={"method": settings.method})
    return registry.put_result(made.schema_name(), None, made.to_dict())

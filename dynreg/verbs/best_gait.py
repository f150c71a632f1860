"""The gait that trials on the robot left, as a document that `dynreg export` writes for it."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynreg.adapt.tried import Tried
from dynreg.data.units import suffix
from dynreg.gait.accept import USUAL
from dynreg.gait.seek import expected, simulated
from dynreg.gait.tasks import Task
from dynreg.gait.trials import Trials, simulators_of
from dynreg.methods.answer import Answer
from dynreg.results.gait import Gait
from dynreg.verbs.gait_document import HowFound, described
from dynreg.verbs.gait_simulators import Chosen
from dynreg.verbs.simulators import simulator
from dynreg.verbs.verb import Built

if TYPE_CHECKING:
    from dynreg.verbs.calibrate import CalibrateSettings


def best_gait(
    asked: Built, settings: "CalibrateSettings", task: Task, found: Answer, identity: str
) -> tuple[str, Gait]:
    """The best gait on the robot, run once more in the last simulator (its id): its id and document, stored."""
    began = time.perf_counter()
    robot, registry = asked.robot, asked.registry
    chosen = Chosen("calibrated", ("simulator",), (simulator(registry, identity, robot),))
    simulators = simulators_of(robot, [one.config for one in chosen.simulators])
    told = {"rate": robot.rate, "seed": settings.seed, "threads": settings.threads}
    trials = Trials(robot, task, simulators, **told)
    what, (unseen,) = simulated(trials, found.gait), expected(trials, found.gait[None])
    how = HowFound(
        None,
        "",
        method=settings.method,
        seed=settings.seed,
        ended=found.ended,
        evaluations=len(found.tried),
        notes=(_on_robot(found.tried, found.best, task),),
    )
    made = described(chosen, trials, what, unseen, time.perf_counter() - began, USUAL, how)
    return registry.put_result(made.schema_name(), None, made.to_dict()), made


def _on_robot(tried: Sequence[Tried], best: Tried, task: Task) -> str:
    """What the robot did: all else in the document is simulated."""
    own, every = len(best.trials), sum(len(one.trials) for one in tried)
    falls = sum(one.fell for one in tried)
    return (
        f"on the robot: {best.score:.4g}{suffix(task.unit)}, the mean of {own} of {every} trials there, of which"
        f" {falls} ended with a fall; all other figures are simulated"
    )

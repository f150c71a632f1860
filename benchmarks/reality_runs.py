"""How benchmarks run Back to Reality: a tape measure, a share of the published sizes, and progress."""

import time
from dataclasses import dataclass, replace

import aibo
import numpy as np

from dynreg.adapt.tried import Rules
from dynreg.gait.tasks import Task, fitness
from dynreg.rng import stream
from dynreg.sim.effects import Terms
from dynreg.sim.engines import Arena
from dynreg.sim.real import disturbance, disturbed, drive_limits
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

FINER = 4  # physics steps of the truth for one of the model
FIXED = 20  # gaits by which simulators are ranked


@dataclass(frozen=True)
class Tape:
    """The hidden robot, and a person with a tape measure: its trials tell how far it walked, or that it fell."""

    hidden: aibo.Hidden
    robot: Robot
    task: Task
    threads: int = 1

    def __call__(self, actions: np.ndarray, rate: float, name: str) -> float | None:
        """The score; None for a fall. Disturbances of a trial are drawn by its name."""
        truth, limits = self.robot.stepped(FINER), drive_limits(self.robot)
        rng = stream(self.hidden.seed, "tape", name)
        run = disturbed(Run(actions[None], period=1.0 / rate), limits, rng)
        terms, values = self.hidden.effects(self.robot)
        active = Terms(terms, tuple(v[None] for v in values)) + disturbance(truth, limits)
        parameters = self.hidden.values(self.robot.space)[None]
        told = {"terms": active, "threads": self.threads, "laid": self.task.laid()}
        walk = Arena(truth, parameters, run, **told).walk(run)
        fell = walk.fell[0, 0] < walk.base.shape[2]
        return None if fell else float(fitness(self.task.grade(walk))[0, 0])


def walking_for(seconds: float) -> Robot:
    """An AIBO whose task lasts so long."""
    robot = load_robot("aibo")
    table = robot.file.tasks[0].model_copy(update={"seconds": seconds})
    return replace(robot, file=robot.file.model_copy(update={"tasks": [table]}))


class Shown:
    """Tells how far it is, ten times a stage at most."""

    def __init__(self) -> None:
        self._last: tuple[str, int] | None = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        if (now := (stage, 10 * done // max(total, 1))) != self._last:
            self._last = now
            print(f"  {time.strftime('%H:%M:%S')} {stage}: {done} of {total}", flush=True)


def scaled(share: float, iterations: int = Rules.iterations) -> Rules:
    """The published sizes with a share of the generations of steps 1 and 3."""
    some = {name: max(round(share * getattr(Rules, name)), 1) for name in ("first", "later", "turns")}
    return Rules(iterations=iterations, **some)

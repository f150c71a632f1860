"""An AIBO with a ball, and the 30 points of paper B's kick: where the ball lies, and where it is to go.

The paper gives the number of points and their ranges. The grid, the ball and the least score of a point that is solved
are our own choice.
"""

import math
import re
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np

from dynreg.gait.tasks import Kick, fitness
from dynreg.methods.by_reality import Played
from dynreg.sim.gait_tables import TaskTable
from dynreg.sim.robot import Robot, load_robot, packaged_robots
from dynreg.sim.run import Walk

DISTANCES = (0.14, 0.18)  # m, of the ball from the neck
BEARINGS = (0.0, 45.0, 90.0)  # deg to the left, of the ball from the neck
DIRECTIONS = (0.0, 45.0, 90.0, 135.0, 180.0)  # deg to the left, into which the ball is to go
AXES = (np.array(DISTANCES), np.deg2rad(BEARINGS), np.deg2rad(DIRECTIONS))
SHAPE = tuple(len(axis) for axis in AXES)
NECK = 0.08  # m ahead of the base's origin
RADIUS, MASS = 0.04, 0.05  # m, kg, of the ball
SECONDS = 2.0  # of a trial
SUCCESS = 0.3  # m, of a point that is solved
# Shells of the legs touch nothing in the packaged model but what has the second bit: the ball.
BALL = f"""<body name="ball" pos="0.4 0 {RADIUS}">
      <freejoint/>
      <geom name="ball" type="sphere" size="{RADIUS}" mass="{MASS}" contype="3" conaffinity="1" rgba="1 0.5 0 1"/>
    </body>"""
MOTION = '\n[[motions]]\nname = "kick"\n'


def with_ball(folder: Path) -> Robot:
    """The packaged AIBO with a ball before it and the motion of 25 genes, in a new folder."""
    source = packaged_robots()["aibo"]
    model = (source / "model.xml").read_text(encoding="utf-8")
    model = model.replace('<default class="link"><geom ', '<default class="link"><geom conaffinity="2" ')
    model = model.replace("</worldbody>", f"  {BALL}\n  </worldbody>")
    model = re.sub(r'(qpos="[^"]*)"', rf'\1 0.4 0 {RADIUS} 1 0 0 0"', model)
    table = (source / "robot.toml").read_text(encoding="utf-8")
    table = table.replace('model = "model.xml"\n', 'model = "model.xml"\ntracked = ["ball"]\n', 1)
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(model, encoding="utf-8")
    (folder / "robot.toml").write_text(table + MOTION, encoding="utf-8")
    return load_robot(folder)


def points() -> list[tuple[float, float, float]]:
    """All 30: distance [m], bearing and direction [rad]."""
    return list(product(*(map(float, axis) for axis in AXES)))


def task_table(name: str, distance: float, bearing: float, direction: float) -> TaskTable:
    """The task of one point, on the grid or between its points."""
    values = {
        "ahead": NECK + distance * math.cos(bearing),
        "left": distance * math.sin(bearing),
        "direction": direction,
    }
    return TaskTable(name=name, kind="kick", motion="kick", seconds=SECONDS, success=SUCCESS, values=values)


def goal_of(at: tuple[int, ...]) -> tuple[float, ...]:
    """Distance [m], bearing and direction [rad] of a point."""
    return tuple(float(axis[i]) for axis, i in zip(AXES, at, strict=True))


@dataclass(eq=False)
class Recorded:
    """Kicks (n, G) of a ball at one place, as step 1 plays them, with their fitness in every direction.

    tasks : one for each direction. at : number of the direction that is sought.
    near : simulators of step 1.
    """

    played: Played
    tasks: list[Kick]
    at: int
    near: int = 1
    kicks: list[np.ndarray] = field(default_factory=list)
    fitness: list[np.ndarray] = field(default_factory=list)

    def __call__(self, kicks: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        walk = self.played.walk(kicks, simulators)
        if len(simulators) <= self.near:
            self.add(kicks, walk)
        return fitness(self.tasks[self.at].grade(walk))

    def add(self, kicks: np.ndarray, walk: Walk) -> None:
        """Keep kicks and what they did in one simulator, or in the worst of some."""
        self.kicks.append(kicks)
        scores = [fitness(task.grade(walk)).min(axis=0) for task in self.tasks]
        self.fitness.append(np.stack(scores, axis=1))

    def best(self, most: int, direction: int) -> np.ndarray:
        """(n, G) the best so many for a direction, no two alike, of those that scored."""
        kicks, scores = np.concatenate(self.kicks), np.concatenate(self.fitness)[:, direction]
        order = np.argsort(-scores, kind="stable")[: int((scores > 0.0).sum())]
        _, first = np.unique(kicks[order], axis=0, return_index=True)
        return kicks[order][np.sort(first)[:most]]

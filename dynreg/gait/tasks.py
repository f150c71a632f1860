"""Tasks: what a gait is sought for. One class each, by kind; plugins through the entry points `dynreg.tasks`."""

import math
from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from dynreg.errors import RobotError, UsageError, one_of, quoted
from dynreg.plugins import with_plugins
from dynreg.sim.gait_tables import TaskTable
from dynreg.sim.layout import BASE, continued
from dynreg.sim.robot import Robot
from dynreg.sim.run import Walk

FELL = -1000.0  # the grade of a fall, but for the share of the time that the robot stood
LEAST = FELL / 2  # of any score: a lower grade means a fall
X, Y, YAW = (BASE.index(name) for name in ("x", "y", "yaw"))


class Task:
    """A task as robot.toml names it. A kind of task gives its score and, where it has numbers, their defaults.

    A robot that fell has the fitness 0, so a score must be above 0 where something was achieved. A score
    below `LEAST` counts as `LEAST`.

    unit : of the fitness. bodies : how many the robot's folder must track for it. defaults : {name: value} of the
    kind's numbers, which `values` of [[tasks]] overrides.
    score(base) : (B, E) from base (B, E, T+1, 12), in the order of `layout.BASE`; see `Walk`. What scores more than the
    base gives `scored(walk)` instead.
    slope() : angle of the ground [rad]. laid() : where the first tracked bodies lie at the start. motion : the robot's
    motion that is sought, None for its gait.
    """

    kind: ClassVar[str]
    unit: ClassVar[str] = "m"
    bodies: ClassVar[int] = 0
    defaults: ClassVar[Mapping[str, float]] = MappingProxyType({})
    score: ClassVar[Callable]

    def __init__(self, table: TaskTable):
        unknown = sorted(set(table.values) - set(self.defaults))
        if unknown:
            raise RobotError(
                f"task {table.name!r}: unknown value {unknown[0]!r}",
                expected=f"some of {quoted(sorted(self.defaults))}",
                do="correct [[tasks]] in robot.toml",
            )
        self.name, self.motion = table.name, table.motion
        self.seconds, self.success = table.seconds, table.success
        self.values = {**self.defaults, **table.values}

    def slope(self) -> float:
        """Angle of the ground [rad], rising ahead."""
        return 0.0

    def laid(self) -> np.ndarray | None:
        """(n, 2) places [m] ahead and to the left of the base; None where the model says it."""
        return None

    def scored(self, walk: Walk) -> np.ndarray:
        """(B, E) scores of walks, whether the robot fell or not."""
        return self.score(walk.base)

    def grade(self, walk: Walk) -> np.ndarray:
        """(B, E) scores of walks; where the robot fell, `FELL` and the share of the time that it stood.

        The fitness of a fall is 0 (`fitness`), but a search that ranks wants to know the less bad ones.
        """
        fallen, scores = walk.fell < walk.base.shape[2], self.scored(walk)
        return np.where(fallen, FELL + walk.fell / walk.base.shape[2], np.maximum(scores, LEAST))


def fell(grades: np.ndarray) -> np.ndarray:
    """Which grades are those of falls."""
    return grades < LEAST


def fitness(grades: np.ndarray) -> np.ndarray:
    """The fitness of grades: the score, 0 for a fall."""
    return np.where(fell(grades), 0.0, grades)


def progress(base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(B, E) metres ahead and to the left, as the robot looked at the start, of base (B, E, T+1, 12)."""
    moved = base[:, :, -1, [X, Y]] - base[:, :, 0, [X, Y]]
    yaw = base[:, :, 0, YAW]
    ahead = np.cos(yaw) * moved[..., 0] + np.sin(yaw) * moved[..., 1]
    return ahead, np.cos(yaw) * moved[..., 1] - np.sin(yaw) * moved[..., 0]


class Forward(Task):
    """Metres ahead less metres of lateral drift."""

    kind = "forward"

    def score(self, base: np.ndarray) -> np.ndarray:
        ahead, left = progress(base)
        return ahead - np.abs(left)


class Slope(Forward):
    """Metres ahead less metres of lateral drift, on ground that rises by `angle` [rad]."""

    kind = "slope"
    defaults = MappingProxyType({"angle": 0.07})

    def slope(self) -> float:
        return self.values["angle"]


class Turn(Task):
    """Radians turned to the left (to the right where `side` is -1), less `drift` [rad/m] for metres moved."""

    kind, unit = "turn", "rad"
    defaults = MappingProxyType({"side": 1.0, "drift": 1.0})

    def score(self, base: np.ndarray) -> np.ndarray:
        turned = continued(base[..., YAW], axis=-1)
        ahead, left = progress(base)
        angle = self.values["side"] * (turned[..., -1] - turned[..., 0])
        return angle - self.values["drift"] * np.hypot(ahead, left)


class Speed(Task):
    """How well `speed` [m/s] straight ahead is kept: 1 where it is, 0 for standing still."""

    kind, unit = "speed", "1"
    defaults = MappingProxyType({"speed": 0.1})

    def __init__(self, table: TaskTable):
        super().__init__(table)
        if self.values["speed"] == 0.0:
            raise RobotError(
                f"task {table.name!r}: speed = 0",
                expected="a speed ahead, or backwards below 0 [m/s]",
                do="correct [[tasks]] in robot.toml",
            )

    def score(self, base: np.ndarray) -> np.ndarray:
        ahead, left = progress(base)
        wanted = self.values["speed"] * self.seconds
        return 1.0 - np.hypot(ahead - wanted, left) / abs(wanted)


class Kick(Task):
    """Metres D that the first tracked body went, less for an angle psi off `direction` [rad, to the left].

    D exp(-k psi^2), with k = `sharpness` [1/rad^2]. With D cos(psi), which is flat about 0, searches do not aim
    (Zagal and Ruiz-del-Solar, who give no k: 5 is our own choice). At the start the body lies `ahead` and `left` [m] of
    the base's origin; where neither is told, as the model has it.
    """

    kind = "kick"
    bodies = 1
    defaults = MappingProxyType({"direction": 0.0, "sharpness": 5.0, "ahead": math.nan, "left": math.nan})

    def __init__(self, table: TaskTable):
        super().__init__(table)
        told = [name for name in ("ahead", "left") if name in table.values]
        if len(told) == 1:
            raise RobotError(
                f"task {table.name!r}: {told[0]} alone",
                expected="ahead and left, or neither where the model says where the ball lies",
                do="correct [[tasks]] in robot.toml",
            )

    def laid(self) -> np.ndarray | None:
        place = np.array([[self.values["ahead"], self.values["left"]]])
        return None if np.isnan(place).any() else place

    def scored(self, walk: Walk) -> np.ndarray:
        if walk.bodies is None:  # nobody saw the ball
            return np.full(walk.fell.shape, np.nan)
        moved = walk.bodies[:, :, -1, 0, :2] - walk.bodies[:, :, 0, 0, :2]
        wanted = walk.base[:, :, 0, YAW] + self.values["direction"]
        angle = np.arctan2(moved[..., 1], moved[..., 0]) - wanted
        angle = np.mod(angle + np.pi, 2 * np.pi) - np.pi
        return np.hypot(*np.moveaxis(moved, -1, 0)) * np.exp(-self.values["sharpness"] * angle**2)


@cache
def kinds() -> Mapping[str, type[Task]]:
    """{kind: class} of dynreg's tasks and those of installed plugins; RobotError where a plugin is none."""
    packaged = {cls.kind: cls for cls in (Forward, Turn, Speed, Slope, Kick)}
    expected = "a class derived from dynreg.gait.tasks.Task, with its kind and score"
    return with_plugins(packaged, "dynreg.tasks", "kind", _made, expected)


def _made(plugin: Any) -> type[Task] | None:
    whole = isinstance(plugin, type) and issubclass(plugin, Task) and hasattr(plugin, "kind")
    scores = whole and (hasattr(plugin, "score") or plugin.scored is not Task.scored)
    return plugin if scores else None


def task_of(robot: Robot, name: str | None = None) -> Task:
    """A robot's task by name, the first where `name` is None.

    Raises RobotError where the robot has none or its kind is unknown, UsageError for an unknown name.
    """
    tables = {table.name: table for table in robot.file.tasks}
    if not tables:
        raise RobotError(
            f"robot {robot.name!r} has no walking task",
            expected="[[tasks]] in robot.toml",
            do="add one, or name a robot that walks, such as 'quadruped'",
        )
    if name is not None and name not in tables:
        raise UsageError(
            f"robot {robot.name!r} has no task {name!r}",
            expected=one_of(tables, name),
            do="choose one of them, or add it to robot.toml",
        )
    table = tables[name or next(iter(tables))]
    if table.kind not in kinds():
        raise RobotError(
            f"task {table.name!r} is of unknown kind {table.kind!r}",
            expected=one_of(kinds(), table.kind),
            do="correct it, or install the plugin that brings it",
        )
    kind = kinds()[table.kind]
    if len(robot.file.robot.tracked) < kind.bodies:
        raise RobotError(
            f"task {table.name!r} scores {kind.bodies} tracked bodies, robot {robot.name!r} has"
            f" {len(robot.file.robot.tracked)}",
            expected="their names in `tracked` of [robot]",
            do="add them to robot.toml, each with a free joint in the MJCF",
        )
    return kind(table)

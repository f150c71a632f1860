"""Open-loop navigation of a robot on wheels: a few timed commands that visit places in any order, and come back.

Pretorius et al., equation 10: four corners of a table and ten commands, which are what is usual here. What the paper
leaves open is ours: where its blocks stand, that a place is visited by a point of the path inside its square, how long
commands last, a gene that leaves a command out, that a path without a way back ends in one of its places, and that
plans are sought by whose path gets well into each square: the best path that just touches one misses it on every robot
but its simulator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, floor
from typing import Protocol, runtime_checkable

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.genetic import Genetic, Rules
from dynreg.timed.commands import Commands, pose_after
from dynreg.timed.models import Continuous, Model, along
from dynreg.timed.task import COMMANDS

TICK = 0.02  # s: the paper's commands last so many of them, of the clock of a robot that is told 50 times a second
SAMPLE = 0.1  # s between points of a path
ROBOT = 0.065  # m, radius of the paper's robot
REWARD, SLOWNESS, MISS, OUTSIDE = 1000.0, 2.5, 5.0, 2.5  # k1 a place, k2 a second, k3 and k4 a centimetre
CM = 100.0
MOST = (0.05, 0.95)  # quantiles between which most commands of a recording lie: a choice
EXACT = 1e-6  # ticks by which a time may miss a multiple that it stands for
# of mutations: of what is told and its time by up to so much; whether it is left out, anew
WIDTHS = (0.2, 0.2, 0.2, 1.0)
PLANNING = Rules(mutation=0.15)  # of the paper's task


@dataclass(frozen=True, eq=False)
class Course:
    """Places to visit, seen from the robot before its first command: x ahead of it, y to its left [m].

    centres : (P, 2) middles of squares. side : of the squares. area : (2, 2) lowest and highest x and y; a path should
    stay there. back : whether it ends at the start; else in the middle of one of the squares.
    """

    centres: np.ndarray
    side: float
    area: np.ndarray
    back: bool = True

    @classmethod
    def around(
        cls,
        places: Sequence[tuple[float, float]],
        side: float,
        area: np.ndarray | None = None,
        back: bool = True,
    ) -> "Course":
        """Squares around places; the area is, unless given, the smallest one that holds them and the start."""
        centres = np.array(places, dtype=float)
        corners = np.concatenate([centres - side / 2, centres + side / 2, np.zeros((1, 2))])
        usual = np.stack([corners.min(axis=0), corners.max(axis=0)])
        return cls(centres, side, usual if area is None else area, back)

    @property
    def ends(self) -> np.ndarray:
        """(E, 2) where a path that visited all may end."""
        return np.zeros((1, 2)) if self.back else self.centres

    @property
    def least_way(self) -> float:
        """Metres that a path drives at least, which gets into the farthest square, and back where it should."""
        far = float(np.linalg.norm(np.maximum(np.abs(self.centres) - self.side / 2, 0.0), axis=1).max())
        return 2.0 * far if self.back else far


SIZE, BLOCK = np.array([1.2, 0.7]), 0.3  # m, of the paper's table and of its blocks
COLUMNS, ROWS = (np.array([-1.0, 1.0]) * (side - BLOCK) / 2 for side in SIZE)
CORNERS = Course(np.array([[x, y] for x in COLUMNS for y in ROWS]), BLOCK, np.stack([-SIZE / 2, SIZE / 2]))


@dataclass(frozen=True, eq=False)
class CommandRange:
    """What a plan's commands may say: two numbers, each from low (2,) to high (2,), and how long they hold [s].

    seconds : shortest and longest; tick : of which times are multiples, 0 for any. wheels : (2, 2) that makes speeds of
    the left and the right wheel on the ground [m/s] of the two numbers. commands : at most so many.
    """

    low: np.ndarray
    high: np.ndarray
    seconds: tuple[float, float]
    tick: float = 0.0
    wheels: np.ndarray = field(default_factory=lambda: np.eye(2))
    commands: int = COMMANDS

    @classmethod
    def used(cls, commands: Commands, wheels: np.ndarray, tick: float, limits: np.ndarray) -> "CommandRange":
        """What most commands of a recording said, from their 5 % to their 95 % quantile; numbers within limits (2, 2).

        limits : the lowest and the highest that the robot takes. No time is rounded to one above the recording's
        longest, unless that is shorter than a tick.
        """
        numbers = np.stack([commands.left, commands.right], axis=1) @ np.linalg.inv(wheels).T
        low, high = np.clip(np.quantile(numbers, MOST, axis=0), *limits)
        shortest, longest = map(float, np.quantile(commands.seconds, MOST))
        most = float(commands.seconds.max())
        if tick and tick * np.round(longest / tick) > most + EXACT * tick:
            longest = tick * max(floor(most / tick + EXACT), 1)
        return cls(low, high, (min(shortest, longest), longest), tick, wheels)

    def lasting(self, shortest: float, longest: float) -> "CommandRange":
        """The same with other times: the multiples of the tick from the shortest to the longest [s].

        Raises UsageError where there is none.
        """
        if not self.tick:
            return replace(self, seconds=(shortest, longest))
        least, most = max(ceil(shortest / self.tick - EXACT), 1), floor(longest / self.tick + EXACT)
        if least > most:
            raise UsageError(
                f"seconds {shortest:g},{longest:g}",
                expected=f"at least one multiple of {self.tick:g} s between them",
                do=f"ask for such as {self.tick * least:g},{self.tick * (least + 1):g}",
                setting="seconds",
            )
        return replace(self, seconds=(self.tick * least, self.tick * most))

    @property
    def fastest(self) -> float:
        """The highest speed of the middle between the wheels [m/s], by what they are told."""
        ends = np.array([(first, second) for first in self._ends(0) for second in self._ends(1)])
        return float(np.abs((ends @ self.wheels.T).mean(axis=1)).max())

    def _ends(self, number: int) -> tuple[float, float]:
        return float(self.low[number]), float(self.high[number])

    def told(self, unit: np.ndarray) -> np.ndarray:
        """(B, n, 2) the two numbers of n commands, of genes (B, 4 n) in the unit cube."""
        half = 0.5 * (self.high - self.low)
        return 0.5 * (self.high + self.low) + half * (2.0 * _by_command(unit)[..., :2] - 1.0)


SPEED = 0.22  # m/s
KHEPERA_RANGE = CommandRange(np.full(2, -SPEED), np.full(2, SPEED), (0.1, 2.0), TICK)


def _by_command(unit: np.ndarray) -> np.ndarray:
    """(B, n, 4) genes of commands: the two numbers, the time, and whether it is left out."""
    return unit.reshape(len(unit), -1, 4)


@dataclass(frozen=True, eq=False)
class Plan:
    """B sequences of n commands; left, right [m/s], seconds, and which are left out: (B, n).

    tick : of which times are multiples [s], 0 for any.
    """

    left: np.ndarray
    right: np.ndarray
    seconds: np.ndarray
    null: np.ndarray
    tick: float = TICK

    @classmethod
    def of(cls, unit: np.ndarray, ranges: CommandRange = KHEPERA_RANGE) -> "Plan":
        """Of genes (B, 4 n) in the unit cube: four for each command."""
        genes, (shortest, longest) = _by_command(unit), ranges.seconds
        left, right = np.moveaxis(ranges.told(unit) @ ranges.wheels.T, -1, 0)
        seconds = shortest + genes[..., 2] * (longest - shortest)
        if ranges.tick:
            seconds = ranges.tick * np.maximum(np.round(seconds / ranges.tick), 1.0)
        return cls(left, right, seconds, genes[..., 3] > 0.5, ranges.tick)

    @property
    def ticks(self) -> np.ndarray:
        """(B, n) how many ticks each command lasts, 0 of those that are left out; UsageError without a tick."""
        if not self.tick:
            raise UsageError(
                "commands of any time last no whole ticks",
                expected="a plan whose range has a tick",
                do="make it with one, such as the robot's period",
            )
        return np.where(self.null, 0, np.round(self.seconds / self.tick)).astype(int)

    def speeds(self, number: int) -> np.ndarray:
        """(T, 2) what the wheels of one plan are told [m/s], left and right, at every tick."""
        sides = np.stack([self.left[number], self.right[number]], axis=1)
        return np.repeat(sides, self.ticks[number], axis=0)


@dataclass(frozen=True, eq=False)
class Path:
    """Where B robots went: points (B, n, S, 3) of each command, NaN after its end; end (B, 3); time (B,) [s]."""

    points: np.ndarray
    end: np.ndarray
    time: np.ndarray


@runtime_checkable
class Drives(Protocol):
    """What drives whole plans: a robot, or a simulator whose state goes on from one command to the next."""

    def drive(self, plan: Plan) -> Path:
        """The paths of B plans; see `driven`."""


def path_along(plan: Plan, poses: np.ndarray) -> Path:
    """The path of poses (B, T + 1, 3) at every tick of B plans, those of shorter ones padded: as `driven` cuts it.

    Points lie as many whole ticks apart as are nearest to 0.1 s. UsageError as `Plan.ticks`.
    """
    ticks = plan.ticks
    begin = np.cumsum(ticks, axis=1) - ticks
    each = max(round(SAMPLE / plan.tick), 1)
    number = np.arange(-(-int(ticks.max(initial=0)) // each))
    after = np.minimum(each * (number + 1), ticks[..., None])
    which = np.arange(len(poses))
    points = poses[which[:, None, None], begin[..., None] + after]
    there = each * number < ticks[..., None]
    last = ticks.sum(axis=1)
    return Path(np.where(there[..., None], points, np.nan), poses[which, last], plan.tick * last)


def driven(plan: Plan, model: Model | Continuous | Drives) -> Path:
    """The path that a model predicts, from the origin, looking along x: points every 0.1 s, and each end."""
    if isinstance(model, Drives):
        return model.drive(plan)
    many, commands = plan.left.shape
    told = ~plan.null
    left, right, seconds = (column[told] for column in (plan.left, plan.right, plan.seconds))
    # a command that was not left out; else from standstill
    follows = np.diff(np.nonzero(told)[0], prepend=-1) == 0
    before = (np.where(follows, np.roll(side, 1), 0.0) for side in (left, right))
    asked = Commands(left, right, seconds, *before)
    found = along(model, asked, SAMPLE)
    moved = np.full((many, commands, found.shape[1], 3), np.nan)
    moved[told] = found
    last = np.maximum(np.ceil(asked.seconds / SAMPLE - 1e-9).astype(int), 1) - 1
    whole = np.zeros((many, commands, 3))
    whole[told] = found[np.arange(len(found)), last]
    points, pose = np.empty_like(moved), np.zeros((many, 3))
    for i in range(commands):
        points[:, i] = pose_after(pose[:, None], moved[:, i])
        pose = pose_after(pose, whole[:, i])
    return Path(points, pose, np.where(plan.null, 0.0, plan.seconds).sum(axis=1))


def visited(path: Path, course: Course = CORNERS, within: float = 0.0) -> np.ndarray:
    """(B, P) which places paths visit, by a point inside the square, `within` [m] from its sides."""
    where, reach = _points(path), course.side / 2 - within
    across, along_it = (np.abs(where[..., i, None] - course.centres[:, i]) <= reach for i in range(2))
    return (across & along_it).any(axis=1)  # NaN is in no square


def short(path: Path, course: Course = CORNERS) -> np.ndarray:
    """(B,) metres from the ends of paths to where they should be when all is visited."""
    return np.linalg.norm(path.end[:, None, :2] - course.ends, axis=2).min(axis=1)


def fitness(path: Path, course: Course = CORNERS, within: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(B,) fitness of paths, and how many places each visits; see `visited`.

    k1 n - k2 t - k3 f - k4 e: n places, t seconds, f [cm] from the end to where it should be if all were visited, else
    to the middle of the nearest that was not, e [cm] the sum over points of how far outside the area they lie.
    """
    found = visited(path, course, within)
    count = found.sum(axis=1)
    missed = np.linalg.norm(path.end[:, None, :2] - course.centres, axis=2)
    left = np.where(found, np.inf, missed).min(axis=1)
    left = np.where(count == len(course.centres), short(path, course), left)
    where, (low, high) = _points(path), course.area
    outside = np.nansum(
        np.linalg.norm(np.maximum(np.maximum(low - where, where - high), 0.0), axis=2), axis=1
    )
    return REWARD * count - SLOWNESS * path.time - CM * (MISS * left + OUTSIDE * outside), count


def _points(path: Path) -> np.ndarray:
    """(B, n S, 2) places on the way."""
    return path.points[..., :2].reshape(len(path.end), -1, 2)


@dataclass(frozen=True, eq=False)
class Evolved:
    """The best genes (4 n,) of an evolution, their fitness in the model and how many places it got well into there.

    history : (candidates tried, best fitness) whenever it rose.
    """

    genes: np.ndarray
    fitness: float
    places: int
    history: tuple[tuple[int, float], ...]


def evolve(
    model: Model | Drives,
    course: Course = CORNERS,
    ranges: CommandRange = KHEPERA_RANGE,
    *,
    generations: int = 10_000,
    rules: Rules = PLANNING,
    within: float = ROBOT,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Evolved:
    """Commands that do best in a model, by the genetic algorithm; `within` as in `visited`.

    rules : of the search; steps of its mutations are `WIDTHS`. progress : called with candidates tried and all.

    Raises UsageError where no point of a square is so far within.
    """
    if not 0.0 <= within < course.side / 2:
        raise UsageError(
            f"within = {within:g} m",
            expected=f"0 to less than {course.side / 2:g}, half a side",
            do="ask for a smaller margin, or larger squares",
        )
    rules = replace(rules, width=np.tile(WIDTHS, ranges.commands))
    search = Genetic(4 * ranges.commands, rng=stream(seed, "navigation"), rules=rules)
    paths = lambda unit: driven(Plan.of(unit, ranges), model)  # noqa: E731
    grades = lambda unit: np.stack(fitness(paths(unit), course, within), axis=1)  # noqa: E731
    judge = lambda both: (both[:, 0], -both[:, 0])  # noqa: E731
    found = drive(search, grades, judge, Limits(generations * rules.population), progress=progress)
    return Evolved(found.best, found.value, int(found.grades[1]), found.history)

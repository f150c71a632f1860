"""The navigation task of the paper on wheeled robots: visit four corners in any order and come back, in ten commands.

Pretorius et al., equation 10. What it leaves open is ours: where blocks stand, that a block is visited by a point of
the path inside it, how long commands last, a gene that leaves a command out, and that plans are sought by whose path
the whole robot gets into each block: the best path that just touches one misses it on every robot but its simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.genetic import Genetic, Rules
from dynreg.timed.commands import Commands, pose_after
from dynreg.timed.models import Model, along

COMMANDS = 10
SPEED = 0.22  # m/s
SECONDS = (0.1, 2.0)
TICK = 0.02  # s: a command lasts so many of them, of the clock of a robot that is told 50 times a second
SAMPLE = 0.1  # s between points of a path
AREA = np.array([1.2, 0.7])  # m
BLOCK = 0.3  # m, a side
ROBOT = 0.065  # m, its radius
COLUMNS, ROWS = (
    np.array([-1.0, 1.0]) * (side - BLOCK) / 2 for side in AREA
)  # m, x and y of the blocks' middles
CENTRES = np.array([[x, y] for x in COLUMNS for y in ROWS])
REWARD, SLOWNESS, MISS, OUTSIDE = 1000.0, 2.5, 5.0, 2.5  # k1 a block, k2 a second, k3 and k4 a centimetre
CM = 100.0
WIDTHS = (
    0.2,
    0.2,
    0.2,
    1.0,
)  # of mutations: of speeds and time by up to so much; whether it is left out, anew


@dataclass(frozen=True, eq=False)
class Plan:
    """B sequences of ten commands; left, right [m/s], seconds, and which are left out: (B, 10)."""

    left: np.ndarray
    right: np.ndarray
    seconds: np.ndarray
    null: np.ndarray

    @classmethod
    def of(cls, unit: np.ndarray) -> "Plan":
        """Of genes (B, 40) in the unit cube: four for each command."""
        left, right, seconds, null = np.moveaxis(unit.reshape(len(unit), COMMANDS, 4), -1, 0)
        asked = SECONDS[0] + seconds * (SECONDS[1] - SECONDS[0])
        return cls(
            SPEED * (2.0 * left - 1.0),
            SPEED * (2.0 * right - 1.0),
            TICK * np.round(asked / TICK),
            null > 0.5,
        )

    @property
    def ticks(self) -> np.ndarray:
        """(B, 10) how many ticks each command lasts; 0 of those that are left out."""
        return np.where(self.null, 0, np.round(self.seconds / TICK)).astype(int)

    def speeds(self, number: int) -> np.ndarray:
        """(T, 2) what the wheels of one plan are told [m/s], left and right, at every tick."""
        sides = np.stack([self.left[number], self.right[number]], axis=1)
        return np.repeat(sides, self.ticks[number], axis=0)


@dataclass(frozen=True, eq=False)
class Path:
    """Where B robots went: points (B, 10, S, 3) of each command, NaN after its end; end (B, 3); time (B,) [s]."""

    points: np.ndarray
    end: np.ndarray
    time: np.ndarray


@runtime_checkable
class Drives(Protocol):
    """What drives whole plans: a robot, or a simulator whose state goes on from one command to the next."""

    def drive(self, plan: Plan) -> Path:
        """The paths of B plans; see `driven`."""


def path_along(plan: Plan, poses: np.ndarray) -> Path:
    """The path of poses (B, T + 1, 3) at every tick of B plans, those of shorter ones padded: as `driven` cuts it."""
    ticks = plan.ticks
    begin = np.cumsum(ticks, axis=1) - ticks
    each = round(SAMPLE / TICK)
    number = np.arange(-(-int(ticks.max(initial=0)) // each))
    after = np.minimum(each * (number + 1), ticks[..., None])
    which = np.arange(len(poses))
    points = poses[which[:, None, None], begin[..., None] + after]
    there = each * number < ticks[..., None]
    return Path(
        np.where(there[..., None], points, np.nan), poses[which, ticks.sum(axis=1)], TICK * ticks.sum(axis=1)
    )


def driven(plan: Plan, model: Model | Drives) -> Path:
    """The path that a model predicts, from the middle, looking along x: points every 0.1 s, and each end."""
    if isinstance(model, Drives):
        return model.drive(plan)
    many, told = len(plan.left), ~plan.null
    left, right, seconds = (column[told] for column in (plan.left, plan.right, plan.seconds))
    follows = (
        np.diff(np.nonzero(told)[0], prepend=-1) == 0
    )  # a command that was not left out; else from standstill
    before = (np.where(follows, np.roll(side, 1), 0.0) for side in (left, right))
    asked = Commands(left, right, seconds, *before)
    found = along(model, asked, SAMPLE)
    moved = np.full((many, COMMANDS, found.shape[1], 3), np.nan)
    moved[told] = found
    last = np.maximum(np.ceil(asked.seconds / SAMPLE - 1e-9).astype(int), 1) - 1
    whole = np.zeros((many, COMMANDS, 3))
    whole[told] = found[np.arange(len(found)), last]
    points, pose = np.empty_like(moved), np.zeros((many, 3))
    for i in range(COMMANDS):
        points[:, i] = pose_after(pose[:, None], moved[:, i])
        pose = pose_after(pose, whole[:, i])
    return Path(points, pose, np.where(plan.null, 0.0, plan.seconds).sum(axis=1))


def fitness(path: Path, within: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(B,) fitness of paths, and the blocks that each visited, by a point inside, `within` [m] from its sides.

    k1 n - k2 t - k3 f - k4 e: n blocks, t seconds, f [cm] from the end to the middle where all four were visited, else
    to the middle of the nearest that was not, e [cm] the sum over points of how far outside the area they lie.
    """
    where = path.points[..., :2].reshape(len(path.end), -1, 2)
    reach = BLOCK / 2 - within
    columns, rows = (np.abs(where[..., i, None] - at) <= reach for i, at in enumerate((COLUMNS, ROWS)))
    visited = (columns[..., :, None] & rows[..., None, :]).any(axis=1).reshape(-1, 4)  # NaN is in no block
    count = visited.sum(axis=1)
    missed = np.linalg.norm(path.end[:, None, :2] - CENTRES, axis=2)
    short = np.where(visited, np.inf, missed).min(axis=1)
    short = np.where(count == 4, np.linalg.norm(path.end[:, :2], axis=1), short)
    beyond = np.linalg.norm(np.maximum(np.abs(where) - AREA / 2, 0.0), axis=2)
    outside = np.nansum(beyond, axis=1)
    return REWARD * count - SLOWNESS * path.time - CM * (MISS * short + OUTSIDE * outside), count


@dataclass(frozen=True, eq=False)
class Evolved:
    """The best genes (40,) of an evolution, their fitness in the model and the blocks that it got into there.

    history : (candidates tried, best fitness) whenever it rose.
    """

    genes: np.ndarray
    fitness: float
    blocks: int
    history: tuple[tuple[int, float], ...]


def evolve(
    model: Model | Drives,
    *,
    generations: int = 10_000,
    population: int = 200,
    tournament: int = 40,
    mutation: float = 0.15,
    within: float = ROBOT,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Evolved:
    """Ten commands that do best in a model, by the genetic algorithm; `within` as in `fitness`.

    progress : called with candidates tried and all.

    Raises UsageError where no point of a block is so far within.
    """
    if not 0.0 <= within < BLOCK / 2:
        raise UsageError(
            f"within = {within:g} m", expected=f"0 to less than {BLOCK / 2:g}, half a block", do="correct it"
        )
    rules = Rules(population, tournament, mutation=mutation, width=np.tile(WIDTHS, COMMANDS))
    search = Genetic(4 * COMMANDS, rng=stream(seed, "navigation"), rules=rules)
    grades = lambda unit: np.stack(fitness(driven(Plan.of(unit), model), within), axis=1)  # noqa: E731
    judge = lambda both: (both[:, 0], -both[:, 0])  # noqa: E731
    found = drive(search, grades, judge, Limits(generations * population), progress=progress)
    return Evolved(found.best, found.value, int(found.grades[1]), found.history)

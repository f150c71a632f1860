"""Paper C whole: controllers evolve in a displacement table, which the robot's own trials keep true, or do not.

Every so many generations the best controller and the second are tried on the robot; what it did is tested against the
table, which follows (`table.updated`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dynreg.rng import stream
from dynreg.search.bits import BitGenetic, Operon
from dynreg.sim.real import Door
from dynreg.timed.commands import Commands
from dynreg.timed.goal import HEADINGS, Mover, Trials, cells, tried
from dynreg.timed.kinematic import kinematic
from dynreg.timed.pulsed import GENES, SPEEDS, Controllers
from dynreg.timed.table import DisplacementTable, Rules, Tested, updated
from dynreg.timed.worn import WornWheels

SAMPLE = 0.5  # s of a displacement
FIRST = 10  # samples of every command, before anything evolves
EVERY = 50  # generations between trials on the robot
TRIED = 2  # controllers then
METHODS = {"operon": Operon, "bits": BitGenetic}


@dataclass(frozen=True)
class Drift:
    """From a generation on, factors on what the left and the right wheel do."""

    generation: int
    left: float
    right: float


@dataclass
class HiddenWheels(Door):
    """The door to a robot on wheels with a secret: what it does to commands, and how that changes.

    It is no `RealRobot`: its controllers look where it is before every step, and its commands are cells of a table.
    track [m]; scatter (3,) standard deviations of half a second's displacement [m, m, rad]; drifts in order of time.
    worn : wheels that make a command depend on the one before it; by default it drives arcs, as told.
    Trials are counted as they begin (`begin`), seconds as it moves (`move`). It never falls.
    """

    drifts: tuple[Drift, ...] = ()
    worn: WornWheels | None = None
    track: float = 0.0884
    scatter: tuple[float, float, float] = (0.002, 0.002, 0.03)
    seed: int = 0
    generation: int = 0
    _rng: np.random.Generator = field(init=False)

    def __post_init__(self):
        self._rng = stream(self.seed, "hidden wheels")

    @property
    def name(self) -> str:
        return "hidden wheels"

    def begin(self, trials: int) -> None:
        """Count trials that begin; BudgetError, before anything moves."""
        self.afford(0.0, trials, falls=0)
        self.spend(0.0, trials)

    def move(self, cell: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        """(n, 3) displacements of half a second of commands (n,); BudgetError, before anything moves.

        before : (n,) as in `truth`.
        """
        self.afford(SAMPLE * len(cell), trials=0, falls=0)
        self.spend(SAMPLE * len(cell), trials=0)
        return self.truth(cell, before) + self._rng.standard_normal((len(cell), 3)) * self.scatter

    def truth(self, cell: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        """(n, 3) what commands (n,) do on average now: for judging, and no search may see it.

        before : (n,) the commands before them, -1 for standstill; by default they were held before, too.
        """
        left, right = self._speeds(cell)
        earlier = (left, right) if before is None else self._speeds(before)
        told = Commands(left, right, np.full(len(cell), SAMPLE), *earlier)
        return self.worn.moved(told, self.track) if self.worn else kinematic(told, self.track)

    def _speeds(self, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) and (n,) [m/s] of the left and the right wheel now; 0 where the cell is -1."""
        left, right = (np.where(cell < 0, 0.0, side[cell]) for side in cells())
        for drift in self.drifts:
            if self.generation >= drift.generation:
                left, right = drift.left * left, drift.right * right
        return left, right


@dataclass(frozen=True, eq=False)
class Evolution:
    """The best controller's genes (396,), its fitness in the table, the table at the end and what updates found.

    error : (updates + 2,) at the beginning, after each update and at the end: mean distance [m] between the table's and
    the robot's mean displacement, over all commands.
    apart : (2, cells) that distance [m] at the end for every command, of the first table and of the last.
    visited : (cells,) commands that the robot was given in trials. history : (generations,) the best fitness in the
    table as it was then. leaders : (generations // every, 396) the best controller then, with update or not.
    """

    genes: np.ndarray
    fitness: float
    table: DisplacementTable
    updates: tuple[Tested, ...]
    error: np.ndarray
    apart: np.ndarray
    visited: np.ndarray
    history: np.ndarray
    leaders: np.ndarray


def measured(robot: HiddenWheels, each: int = FIRST) -> DisplacementTable:
    """Every command of the robot, `each` times in one trial, held before as well."""
    robot.begin(SPEEDS**2)
    cell = np.repeat(np.arange(SPEEDS**2), each)
    return DisplacementTable.of(SPEEDS**2, cell, robot.move(cell))


def evolve(
    robot: HiddenWheels,
    *,
    first: DisplacementTable | None = None,
    update: bool = True,
    rules: Rules | None = None,
    method: str = "operon",
    generations: int = 2000,
    every: int = EVERY,
    population: int = 50,
    seed: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> Evolution:
    """Controllers for the robot as it is at the end; without `update` the table stays what it was at the beginning.

    first : the table at the beginning, such as another robot's; by default it is measured on this one.
    progress : called with generations done and the best fitness.
    """
    first = table = measured(robot) if first is None else first
    rng = stream(seed, "evolution", "draws")
    search = METHODS[method](GENES, rng=stream(seed, "evolution", method), population=population)
    updates, errors, history, leaders = [], [_error(table, robot)], [], []
    visited = np.zeros(table.cells, dtype=bool)
    for generation in range(generations):
        robot.generation = generation
        asked = search.ask()
        found = tried(Controllers.of(asked), mover_of(table, rng)).fitness
        search.tell(-found)
        order = np.argsort(-found, kind="stable")
        history.append(float(found[order[0]]))
        if progress:
            progress(generation + 1, history[-1])
        if (generation + 1) % every:
            continue
        leaders.append(asked[order[0]])
        if update:
            cell, values = _tried_on(robot, asked[order[:TRIED]])
            visited[cell] = True
            table, tested = updated(table, cell, values, generation, rules)
            updates.append(tested)
            errors.append(_error(table, robot))
    errors.append(_error(table, robot))
    apart = np.array([_apart(t, robot) for t in (first, table)])
    best = int(order[0])
    return Evolution(
        asked[best],
        float(found[best]),
        table,
        tuple(updates),
        np.array(errors),
        apart,
        visited,
        np.array(history),
        np.array(leaders).reshape(-1, GENES),
    )


def judged(robot: HiddenWheels, genes: np.ndarray, times: int = 10) -> Trials:
    """A controller (396,) on the robot, `times` for each heading."""
    repeats = int(np.ceil(times * 2 / len(HEADINGS)))
    robot.begin(repeats * len(HEADINGS))
    return tried(Controllers.of(np.tile(genes, (repeats, 1))), robot.move)


def _tried_on(robot: HiddenWheels, genes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (n,) and displacements (n, 3) of trials of controllers (B, 396) on the robot."""
    robot.begin(len(genes) * len(HEADINGS))
    told: list[np.ndarray] = []
    moved: list[np.ndarray] = []

    def logged(cell: np.ndarray, before: np.ndarray) -> np.ndarray:
        told.append(cell)
        moved.append(robot.move(cell, before))
        return moved[-1]

    tried(Controllers.of(genes), logged)
    return np.concatenate(told), np.concatenate(moved)


def mover_of(table: DisplacementTable, rng: np.random.Generator) -> Mover:
    """What commands do by a table: each draw from the normal distribution of its cell, whatever was told before."""
    _, mean, deviation = table.moments()
    return lambda cell, _: mean[cell] + deviation[cell] * rng.standard_normal((len(cell), 3))


def _error(table: DisplacementTable, robot: HiddenWheels) -> float:
    return float(np.nanmean(_apart(table, robot)))


def _apart(table: DisplacementTable, robot: HiddenWheels) -> np.ndarray:
    """(cells,) [m] between the table's and the robot's mean displacement."""
    every = np.arange(table.cells)
    return np.hypot(*(table.moments()[1] - robot.truth(every))[:, :2].T)

"""Two recordings of a wheeled robot in the same cells, held against the same reference."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of
from dynreg.data.recording import Recording
from dynreg.errors import LogError
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.cells import Grid, Pieces, pieces
from dynreg.timed.commands import Commands
from dynreg.timed.reference import Reference, fitted, on_the_way
from dynreg.timed.table import Rules
from dynreg.timed.told import Told, told
from dynreg.timed.wheels import law_of

STILL = 0.1  # of the fastest wheel speed that is compared: a slower wheel is taken for still


@dataclass(frozen=True)
class Plan:
    """How two recordings are held against each other.

    sample : seconds of a piece. cells : on each side. rules : of the tests. splits : of the earlier recording, to
    measure how often the tests err. seed : of every draw.
    """

    sample: float
    cells: int
    rules: Rules
    splits: int
    seed: int


@dataclass(frozen=True)
class Held:
    """One of the two recordings, with its name."""

    recording: Recording
    name: str


@dataclass(frozen=True, eq=False)
class Compared:
    """Two recordings in cells: pieces and what is left of each over the reference, (n, 3) and (m, 3)."""

    grid: Grid
    reference: Reference
    old: Pieces
    new: Pieces
    old_off: np.ndarray
    new_off: np.ndarray

    @property
    def alike(self) -> float:
        """The share, by pieces, of how both were driven: each wheel ahead, back or still, now and just before."""
        old, new = (
            _ways(p.commands, STILL * max(-self.grid.low, self.grid.high)) for p in (self.old, self.new)
        )
        many = 1 + max(old.max(), new.max())
        shares = [np.bincount(ways, minlength=many) / len(ways) for ways in (old, new)]
        return float(np.minimum(*shares).sum())


def _ways(commands: Commands, still: float) -> np.ndarray:
    """(n,) a number for each way of driving. still : wheel speed [m/s] up to which a wheel is taken for still."""
    columns = (commands.left, commands.right, commands.left_before, commands.right_before)
    signs = np.array([np.sign(c) * (np.abs(c) > still) for c in columns]).astype(int) + 1
    return np.ravel_multi_index(tuple(signs), (3,) * len(columns))


def compared(robot: Robot, recent: Held, earlier: Held, plan: Plan) -> Compared:
    """Both in pieces, over the reference that the earlier one gives.

    Raises RobotError for a robot without wheels, LogError for a recording without a pose or without pieces of
    `plan.sample` seconds.
    """
    old_told, new_told = (told(robot, held.recording, longest=plan.sample) for held in (earlier, recent))
    grid = _grid(robot, old_told, plan.cells)
    nominal = Reference(law_of(robot.file.base), robot.file.base.track)
    begun = _pieces(old_told, grid, plan.sample, nominal)
    _require(begun, old_told, earlier, plan.sample)
    reference = fitted(nominal, begun.commands, begun.moved, stream(plan.seed, "drift", "fitted commands"))
    old, new = (_pieces(t, grid, plan.sample, reference) for t in (old_told, new_told))
    _require(new, new_told, recent, plan.sample)
    off = [p.moved - reference.predict(p.commands) for p in (old, new)]
    return Compared(grid, reference, old, new, *off)


def _grid(robot: Robot, earlier: Told, cells: int) -> Grid:
    """Over the range of the robot's wheel commands; over that of the earlier recording where it states none."""
    base = robot.file.base
    wheels = [a for a in robot.file.actions if joint_of(a.name) in (base.left, base.right)]
    if wheels and all(a.low is not None and a.high is not None for a in wheels):
        low, high = min(a.low for a in wheels), max(a.high for a in wheels)
        return Grid(base.wheel_radius * low, base.wheel_radius * high, cells)
    speeds = np.concatenate([earlier.commands.left, earlier.commands.right])
    return Grid(float(speeds.min()), float(speeds.max()), cells)


def _pieces(of: Told, grid: Grid, sample: float, reference: Reference) -> Pieces:
    begun = on_the_way(of.commands, of.episode, reference)
    return pieces(begun, of.moved, of.episode, grid, sample, of.commands)


def _require(found: Pieces, of: Told, held: Held, sample: float) -> None:
    """LogError where no piece is left, with what there is."""
    if len(found.commands):
        return
    seconds = of.commands.seconds
    if found.outside > found.short + found.long:
        raise LogError(
            f"recording {held.name!r} has no command at the compared speeds: {found.outside} pieces lie beyond them",
            expected="speeds within the limits of the robot's wheels, or within those of the earlier recording",
            do="give an earlier recording that was driven as fast, or `low` and `high` of the wheels in robot.toml",
        )
    raise LogError(
        f"recording {held.name!r} has no command of {sample:g} s ({found.short} shorter, {found.long} longer"
        f" pieces, {found.outside} beyond the robot's range; half of them last {np.median(seconds):.3g} s or more)",
        expected="commands held as long as a sample, or longer with poses in between",
        do=f"give --sample {np.median(seconds):.2g}, or log the pose more often",
    )

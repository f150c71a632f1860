"""Two recordings of a wheeled robot in the same cells, held against the same reference."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of
from dynreg.data.recording import Recording
from dynreg.errors import LogError, UsageError
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.cells import Grid, Pieces, pieces
from dynreg.timed.reference import Reference, fitted, on_the_way
from dynreg.timed.table import Rules
from dynreg.wheeled import Told, told


@dataclass(frozen=True)
class DriftSettings:
    """What is asked for. sample : seconds of a piece. cells : on each side. splits : of the earlier recording.

    level, welch, together : of the tests, see `timed.table.Rules`.
    """

    sample: float = 0.5
    cells: int = 20
    level: float = 0.05
    welch: bool = False
    together: bool = True
    splits: int = 200
    seed: int = 0

    def __post_init__(self):
        for name, value, good, expected in (
            ("sample", self.sample, 0.0 < self.sample < float("inf"), "a positive time in seconds"),
            ("cells", self.cells, 1 <= self.cells <= 200, "1 to 200 cells on each side"),
            ("level", self.level, 0.0 < self.level < 1.0, "a level between 0 and 1, such as 0.05"),
            ("splits", self.splits, self.splits >= 0, "0 or more"),
        ):
            if not good:
                raise UsageError(f"{name} {value:g}", expected=expected, do="give another number")

    @property
    def rules(self) -> Rules:
        """For the tests."""
        return Rules(level=self.level, welch=self.welch, together=self.together)


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


def compared(robot: Robot, recent: Held, earlier: Held, settings: DriftSettings) -> Compared:
    """Both in pieces, over the reference that the earlier one gives.

    Raises RobotError for a robot without wheels, LogError for a recording without a pose or without pieces of
    `settings.sample` seconds.
    """
    old_told, new_told = (told(robot, held.recording, longest=settings.sample) for held in (earlier, recent))
    grid = _grid(robot, old_told, settings.cells)
    nominal = _nominal(robot)
    begun = _pieces(old_told, grid, settings.sample, nominal)
    _require(begun, old_told, earlier, settings.sample)
    reference = fitted(
        nominal, begun.commands, begun.moved, stream(settings.seed, "drift", "fitted commands")
    )
    old, new = (_pieces(t, grid, settings.sample, reference) for t in (old_told, new_told))
    _require(new, new_told, recent, settings.sample)
    off = [p.moved - reference.predict(p.commands) for p in (old, new)]
    return Compared(grid, reference, old, new, *off)


def _nominal(robot: Robot) -> Reference:
    base = robot.file.base
    parameters = (
        base.speed_lag,
        base.yaw_lag,
        base.centrifugal,
        base.speed_drag,
        base.coupling,
        base.yaw_drag,
    )
    return Reference(np.array(parameters), base.track)


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
    raise LogError(
        f"recording {held.name!r} has no command of {sample:g} s ({found.short} shorter, {found.long} longer"
        f" pieces, {found.outside} beyond the robot's range; half of them last {np.median(seconds):.3g} s or more)",
        expected="commands held as long as a sample, or longer with poses in between",
        do=f"give --sample {np.median(seconds):.2g}, or log the pose more often",
    )

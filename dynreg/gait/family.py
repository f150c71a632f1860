"""A family of gaits: its genes, the joint commands that they mean, and what is feasible.

What all families have in common is here. A kind of family (`sines`, `locus`, `poses`) says which genes there are, what
the joints are told by them, and how a gait that the robot cannot run is made feasible.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from dynreg.errors import RobotError, UsageError, quoted
from dynreg.gait.table import JointTable, faded
from dynreg.sim.excitation import command_limits, reset_pose
from dynreg.sim.gait_tables import MotionTable
from dynreg.sim.robot import Robot
from dynreg.sim.sets import is_limit

SLACK = 1e-9  # rad, rad/s: what rounding may add
POINTS = 128  # of a period of smooth joint angles: between them a sine of 0.6 rad is 0.2 mrad off
# Of the ranges, 1 sigma, of draws about the pose at rest. Our own choice, for sines: with it searches that set out from
# the best draw end faster (bench_gait_search). No bench has tried it on other families.
SCATTER = 0.12


@dataclass(frozen=True)
class Gene:
    """One number of a gait; a periodic one begins again at `low` where it passes `high`."""

    name: str
    unit: str
    low: float
    high: float
    periodic: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Family(ABC):
    """The gaits of one kind that a robot can be told.

    pose : (A,) [rad] at rest. low, high : (A,) position limits [rad]. speed : (A,) rate limits [rad/s].
    ramp : time [s] in which a gait fades in from rest. first : {gene: value} of the gaits that searches try first.

    told_by : the class of the tables of robot.toml that can be of this kind.

    Each kind must give `of`, `targets`, `feasible`, `problems`, `frequency` and `fastest`. Two methods are optional.
    `rest` says which genes mean the pose at rest, so that searches draw near it; without it they draw anywhere.
    `table` is needed where a motion does not repeat, or where its joints turn sharply between two of `POINTS` times.
    """

    kind: ClassVar[str]
    told_by: ClassVar[type[MotionTable]] = MotionTable

    robot: str
    actions: tuple[str, ...]
    genes: tuple[Gene, ...]
    ramp: float
    pose: np.ndarray
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    first: tuple[Mapping[str, float], ...]

    def __len__(self) -> int:
        return len(self.genes)

    @classmethod
    @abstractmethod
    def of(cls, robot: Robot, table: Any) -> Self:
        """The gaits of a robot by a table of its robot.toml; RobotError where they do not fit together."""

    @abstractmethod
    def targets(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(n, T, A) what the joints are told [rad] by gaits (n, G) at times (T,) [s], from rest at 0."""

    @abstractmethod
    def feasible(self, genes: np.ndarray) -> np.ndarray:
        """(n, G) gaits as they are, those that the robot cannot run changed as little as need be."""

    @abstractmethod
    def problems(self, genes: np.ndarray) -> tuple[str, ...]:
        """What keeps a gait (G,) from being run, before anything moves; nothing where it is feasible."""

    @abstractmethod
    def frequency(self, genes: np.ndarray) -> float | None:
        """Periods a second [Hz] of a gait (G,); None of a motion that is made once."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Most periods a second [Hz] of any gait; 0 where none has a period."""

    @property
    def rest(self) -> np.ndarray:
        """(G,) genes of what stands in the pose at rest, NaN where any value does."""
        return np.full(len(self), np.nan)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the genes (G,)."""
        return tuple(g.name for g in self.genes)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(G, 2) low and high."""
        return np.array([[g.low, g.high] for g in self.genes])

    @cached_property
    def periodic(self) -> np.ndarray:
        """(G,) which genes are phases."""
        return np.array([g.periodic for g in self.genes])

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """(..., G) genes of points in the unit cube; points outside are first brought in by `inside`."""
        return self.bounds[:, 0] + self.inside(unit) * (self.bounds[:, 1] - self.bounds[:, 0])

    def inside(self, unit: np.ndarray) -> np.ndarray:
        """(..., G) points in the unit cube, of points that may lie outside: clipped, but phases run round."""
        return np.where(self.periodic, np.mod(unit, 1.0), np.clip(unit, 0.0, 1.0))

    def to_unit(self, genes: np.ndarray) -> np.ndarray:
        """(..., G) points in the unit cube of genes."""
        return (genes - self.bounds[:, 0]) / (self.bounds[:, 1] - self.bounds[:, 0])

    @property
    def starts(self) -> np.ndarray:
        """(n, G) the gaits that searches try first, in the unit cube; none where robot.toml names none."""
        middle = self.as_dict(self.bounds.mean(axis=1))
        genes = [self.from_dict({**middle, **gait}) for gait in self.first]
        return self.to_unit(np.array(genes).reshape(-1, len(self)))

    def about_rest(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, G) draws in the unit cube: about the pose at rest where a gene tells of it, else anywhere."""
        draws, rest = rng.uniform(size=(count, len(self))), self.to_unit(self.rest)
        about = rest + SCATTER * rng.standard_normal(draws.shape)
        return self.inside(np.where(np.isnan(rest), draws, about))

    def table(self, genes: np.ndarray) -> JointTable:
        """What a gait (G,) tells the joints, without the ramp."""
        period = 1.0 / self.frequency(genes)
        times = np.linspace(0.0, period, POINTS + 1)
        whole = period * np.ceil(self.ramp / period)  # the first period after the ramp
        targets = self.targets(genes[None], whole + times)[0]
        targets[-1] = targets[0]
        return JointTable(period, times, targets)

    def as_dict(self, genes: np.ndarray) -> dict[str, float]:
        """{name: value} of one gait (G,)."""
        return {name: float(value) for name, value in zip(self.names, genes, strict=True)}

    def from_dict(self, genes: Mapping[str, float]) -> np.ndarray:
        """(G,) from {name: value}; UsageError where the names are not those of this robot's genes."""
        if set(genes) != set(self.names):
            wrong = sorted(set(genes) ^ set(self.names))
            raise UsageError(
                f"a gait with genes {quoted(sorted(genes))} for robot {self.robot!r} ({wrong[0]!r} does not fit)",
                expected=f"{quoted(self.names)}",
                do="name a gait of this robot",
            )
        return np.array([float(genes[name]) for name in self.names])

    def require(self, genes: np.ndarray) -> None:
        """UsageError where a gait (G,) is not feasible."""
        if found := self.problems(genes):
            raise UsageError(
                f"this gait cannot be run on robot {self.robot!r}: {found[0]}"
                + (f" (and {len(found) - 1} more)" if len(found) > 1 else ""),
                expected="joint angles and rates within the robot's limits",
                do="correct the genes, or seek a gait with `dynreg gait`",
            )

    def require_any(self, smallest: np.ndarray) -> None:
        """RobotError where not even the smallest gait (G,) is feasible: then none is."""
        if found := self.problems(smallest):
            raise RobotError(
                f"no gait of robot {self.robot!r} keeps its limits: in the smallest, {found[0]}",
                expected="[gait] and [[motions]] with one within the limits of the joints and drives",
                do="lengthen `ramp`, or change the ranges or the limits in robot.toml",
            )

    def faded(self, moving: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(..., T, A) joint angles [rad] that come from rest at time 0 into a motion (..., T, A), in `ramp` seconds."""
        return faded(moving, self.pose, self.ramp, times)

    def past(self, at: int, low: float, high: float, fastest: float) -> list[str]:
        """Which limits action number `at` would pass between `low` and `high` [rad] at up to `fastest` [rad/s]."""
        out, action = [], self.actions[at]
        if low < self.low[at] - SLACK or high > self.high[at] + SLACK:
            out.append(
                f"{action} would go from {low:.3f} to {high:.3f} rad, "
                f"past its limits {self.low[at]:.3f} and {self.high[at]:.3f}"
            )
        if fastest > self.speed[at] + SLACK * max(fastest, 1.0):
            out.append(f"{action} would turn at {fastest:.2f} rad/s, past its limit {self.speed[at]:.2f}")
        return out

    def outside(self, genes: np.ndarray) -> list[str]:
        """The genes of a gait (G,) that lie outside their bounds."""
        return [
            f"{g.name} = {value:g} {g.unit} lies outside [{g.low:g}, {g.high:g}]"
            for g, value in zip(self.genes, genes, strict=True)
            if not g.low - SLACK <= value <= g.high + SLACK
        ]


def of_robot(robot: Robot, table: MotionTable, joints: Iterable[str] | None = None) -> dict[str, Any]:
    """What every family takes from the robot and its own table: the common fields, but for genes and ramp.

    joints : those that gaits move, by default all that are driven. Raises RobotError where one of them is driven by
    something else than angles.
    """
    _require_angles(robot, robot.joints if joints is None else joints)
    low, high, speed = _limits(robot)
    return {
        "robot": robot.name,
        "actions": robot.actions,
        "pose": reset_pose(robot),
        "low": low,
        "high": high,
        "speed": speed,
        "first": tuple(table.start),
    }


def _require_angles(robot: Robot, joints: Iterable[str]) -> None:
    """RobotError where the drive of a joint takes no angle: torques and speeds are nothing that a gait tells."""
    from dynreg.sim.ports import nominal_ports, takes_positions

    ports = nominal_ports(robot, 1)
    angles = dict(zip(robot.joints, takes_positions(ports), strict=True))
    if other := [joint for joint in joints if not angles.get(joint, True)]:
        kind = ports.types[robot.joints.index(other[0])]
        raise RobotError(
            f"joint {other[0]!r} of robot {robot.name!r} has a drive of type {kind!r}, and a gait tells joints angles",
            expected='drives of the legs that take angles, such as type = "position"',
            do="name the joint's own position loop in [[drives]], or leave the joint out of [gait] and [[motions]]",
        )


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A,) lowest and highest angle [rad], of the actions or the model, and the drives' highest rate [rad/s] or inf."""
    from dynreg.sim.ports import nominal_ports

    low, high = command_limits(robot).T
    speed = nominal_ports(robot, 1).drive["speed_limit"][0]
    return low, high, np.where(is_limit(speed), speed, np.inf)


def ranged(robot: Robot, genes: tuple[Gene, ...], table: MotionTable) -> tuple[Gene, ...]:
    """The genes with the bounds that `ranges` of a table gives instead.

    Raises RobotError where it or `start` names no gene, or where a start lies outside the bounds.
    """
    names = [g.name for g in genes]
    for where, name in [("ranges", n) for n in table.ranges] + [("start", n) for s in table.start for n in s]:
        if name not in names:
            raise RobotError(
                f"{where} names {name!r} of a motion of kind {table.kind!r}",
                expected=f"some of {quoted(names)}",
                do="correct it in robot.toml",
            )
    made = tuple(Gene(g.name, g.unit, *table.ranges.get(g.name, (g.low, g.high)), g.periodic) for g in genes)
    bounds = {g.name: (g.low, g.high) for g in made}
    for name, value in (item for gait in table.start for item in gait.items()):
        if not bounds[name][0] <= value <= bounds[name][1]:
            raise RobotError(
                f"start: {name} = {value} of robot {robot.name!r}",
                expected="a value from {:g} to {:g}".format(*bounds[name]),
                do="correct it in robot.toml, or widen `ranges`",
            )
    return made

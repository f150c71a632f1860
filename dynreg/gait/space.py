"""The sinusoidal gait of a legged robot: its genes, the joint commands that they mean, and what is feasible.

In leg l the joint of role j is told q_lj(t) = s_lj (o_j + A_j sin(2 pi f t + phi_l + psi_j)): one frequency f,
for every role an amplitude A, an offset o and a phase psi, for every leg but the first a phase phi. s is -1 for
mirrored joints. Three roles and four legs make the 13 genes of the paper.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.errors import RobotError, UsageError
from dynreg.sim.excitation import command_limits, reset_pose
from dynreg.sim.robot import Robot

SLACK = 1e-9  # rad, rad/s: what rounding may add
# Draws about the pose at rest, as shares of the ranges: how far offsets and phases scatter (1 sigma), and the largest
# amplitude. Most of them fall, too, but searches that set out from the best end faster (bench_gait_search).
OFFSETS, PHASES, LARGEST = 0.12, 0.03, 0.35
ANY = 0.25  # of these draws whose legs have any phases


@dataclass(frozen=True)
class Gene:
    """One number of a gait; a periodic one begins again at `low` where it passes `high`."""

    name: str
    unit: str
    low: float
    high: float
    periodic: bool = False


@dataclass(frozen=True, eq=False)
class GaitSpace:
    """The gaits that a robot can be told.

    columns : (L, R) number of the action of every leg and role. signs : (L, R). pose : (A,) [rad] at rest.
    low, high : (A,) position limits [rad]. speed : (A,) rate limits [rad/s]. first : {gene: value} of the gaits that
    searches try first.
    """

    robot: str
    actions: tuple[str, ...]
    roles: tuple[str, ...]
    legs: tuple[str, ...]
    genes: tuple[Gene, ...]
    ramp: float
    columns: np.ndarray
    signs: np.ndarray
    pose: np.ndarray
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    first: tuple[Mapping[str, float], ...]

    def __len__(self) -> int:
        return len(self.genes)

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
        """(..., G) genes of points in the unit cube, clipped to it; phases run round."""
        unit = np.where(self.periodic, np.mod(unit, 1.0), np.clip(unit, 0.0, 1.0))
        return self.bounds[:, 0] + unit * (self.bounds[:, 1] - self.bounds[:, 0])

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
        """(count, G) draws in the unit cube of gaits that swing a little about the pose at rest.

        Each leg is in phase with the first or against it, as in a trot, a pace or a bound; of a quarter of the draws
        it has any phase, as in a walk.
        """
        draws, roles, legs = rng.uniform(size=(count, len(self))), len(self.roles), len(self.legs) - 1
        rest = self.bounds.mean(axis=1)
        rest[1 + roles : 1 + 2 * roles] = (self.signs * self.pose[self.columns]).mean(axis=0)
        offset = self.to_unit(rest)[1 + roles : 1 + 2 * roles]
        draws[:, 1 : 1 + roles] *= LARGEST
        draws[:, 1 + roles : 1 + 2 * roles] = offset + OFFSETS * rng.standard_normal((count, roles))
        against = 0.5 + 0.5 * rng.integers(0, 2, (count, legs)) + PHASES * rng.standard_normal((count, legs))
        free = rng.uniform(size=(count, 1)) < ANY
        draws[:, len(self) - legs :] = np.where(free, draws[:, len(self) - legs :], against)
        return np.where(self.periodic, np.mod(draws, 1.0), np.clip(draws, 0.0, 1.0))

    def as_dict(self, genes: np.ndarray) -> dict[str, float]:
        """{name: value} of one gait (G,)."""
        return {name: float(value) for name, value in zip(self.names, genes, strict=True)}

    def from_dict(self, genes: Mapping[str, float]) -> np.ndarray:
        """(G,) from {name: value}; UsageError where the names are not those of this robot's genes."""
        if set(genes) != set(self.names):
            wrong = sorted(set(genes) ^ set(self.names))
            raise UsageError(
                f"a gait with genes {sorted(genes)} for robot {self.robot!r} ({wrong[0]!r} does not fit)",
                expected=f"{list(self.names)}",
                do="name a gait of this robot",
            )
        return np.array([float(genes[name]) for name in self.names])

    def targets(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(n, T, A) what the joints are told [rad] by gaits (n, G) at times (T,) [s], from rest at 0."""
        roles, legs = len(self.roles), len(self.legs)
        frequency, amplitude, offset, phase, leg_phase = np.split(
            genes, np.cumsum([1, roles, roles, roles]), axis=1
        )
        leg_phase = np.concatenate([np.zeros((len(genes), 1)), leg_phase], axis=1)
        shift = leg_phase[:, :, None] + phase[:, None, :]  # (n, L, R)
        turn = 2 * np.pi * frequency * times  # (n, T)
        swing = amplitude[:, None, None] * np.sin(turn[:, :, None, None] + shift[:, None])
        joints = self.signs * (offset[:, None, None] + swing)  # (n, T, L, R)
        out = np.tile(self.pose, (len(genes), len(times), 1))
        begun = np.clip(times / self.ramp, 0.0, 1.0)[None, :, None]
        columns = self.columns.reshape(-1)
        moving = joints.reshape(len(genes), len(times), roles * legs)
        out[..., columns] += begun * (moving - out[..., columns])
        return out

    def feasible(self, genes: np.ndarray) -> np.ndarray:
        """(n, G) gaits as they are, where need be with offsets inside the joints' limits and smaller amplitudes."""
        genes = np.clip(genes, *self.bounds.T)
        roles = len(self.roles)
        frequency = genes[:, :1]
        offset = np.clip(genes[:, 1 + roles : 1 + 2 * roles], *self._role_limits)
        room = np.minimum(offset - self._role_limits[0], self._role_limits[1] - offset)
        rate = self.speed[self.columns].min(axis=0) - self._reach(offset) / self.ramp
        most = np.minimum(room, rate / (2 * np.pi * frequency + 1.0 / self.ramp))
        genes[:, 1 : 1 + roles] = np.clip(genes[:, 1 : 1 + roles], 0.0, np.maximum(most, 0.0))
        genes[:, 1 + roles : 1 + 2 * roles] = offset
        return genes

    def problems(self, genes: np.ndarray) -> tuple[str, ...]:
        """What keeps a gait (G,) from being run, before anything moves; nothing where it is feasible."""
        out = [
            f"{g.name} = {value:g} {g.unit} lies outside [{g.low:g}, {g.high:g}]"
            for g, value in zip(self.genes, genes, strict=True)
            if not g.low - SLACK <= value <= g.high + SLACK
        ]
        roles = len(self.roles)
        frequency, amplitude = genes[0], genes[1 : 1 + roles]
        offset = genes[1 + roles : 1 + 2 * roles]
        fastest = amplitude * (2 * np.pi * frequency + 1 / self.ramp) + self._reach(offset) / self.ramp
        for leg, role in np.ndindex(*self.columns.shape):
            at = self.columns[leg, role]
            centre = self.signs[leg, role] * offset[role]
            reach = (centre - amplitude[role], centre + amplitude[role])
            if reach[0] < self.low[at] - SLACK or reach[1] > self.high[at] + SLACK:
                out.append(
                    f"{self.actions[at]} would go from {reach[0]:.3f} to {reach[1]:.3f} rad, "
                    f"past its limits {self.low[at]:.3f} and {self.high[at]:.3f}"
                )
            if fastest[role] > self.speed[at] + SLACK:
                out.append(
                    f"{self.actions[at]} would turn at {fastest[role]:.2f} rad/s, "
                    f"past its limit {self.speed[at]:.2f}"
                )
        return tuple(out)

    def require(self, genes: np.ndarray) -> None:
        """UsageError where a gait (G,) is not feasible."""
        if found := self.problems(genes):
            raise UsageError(
                f"this gait cannot be run on robot {self.robot!r}: {found[0]}"
                + (f" (and {len(found) - 1} more)" if len(found) > 1 else ""),
                expected="joint angles and rates within the robot's limits",
                do="correct the genes, or seek a gait with `dynreg gait`",
            )

    @cached_property
    def _role_limits(self) -> np.ndarray:
        """(2, R) lowest and highest angle that the joints of a role all can reach, before mirroring."""
        low, high = self.low[self.columns], self.high[self.columns]
        flipped = self.signs < 0
        return np.stack(
            [np.where(flipped, -high, low).max(axis=0), np.where(flipped, -low, high).min(axis=0)]
        )

    def _reach(self, offset: np.ndarray) -> np.ndarray:
        """(..., R) how far [rad] the ramp takes the joints of a role from rest to their offset."""
        rest = self.signs * self.pose[self.columns]
        return np.abs(offset[..., None, :] - rest).max(axis=-2)


def gait_space(robot: Robot) -> GaitSpace:
    """The gaits of a robot, as its robot.toml gives them; RobotError where it has no [gait]."""
    table = robot.file.gait
    if table is None:
        raise RobotError(
            f"robot {robot.name!r} has no walking task",
            expected="[gait] with its legs and roles, and [[tasks]], in robot.toml",
            do="add them, or name a robot that walks, such as 'quadruped'",
        )
    genes = [Gene("frequency", "Hz", *table.frequency)]
    genes += [Gene(f"amplitude_{role.name}", "rad", *role.amplitude) for role in table.roles]
    genes += [Gene(f"offset_{role.name}", "rad", *role.offset) for role in table.roles]
    phases = [f"phase_{part.name}" for part in (*table.roles, *table.legs[1:])]
    genes += [Gene(name, "rad", -np.pi, np.pi, True) for name in phases]
    columns = [[robot.joints.index(leg.joints[role.name]) for role in table.roles] for leg in table.legs]
    signs = [[-1.0 if role.name in leg.mirrored else 1.0 for role in table.roles] for leg in table.legs]
    low, high, speed = _limits(robot)
    return GaitSpace(
        robot.name,
        robot.actions,
        tuple(role.name for role in table.roles),
        tuple(leg.name for leg in table.legs),
        tuple(genes),
        table.ramp,
        np.array(columns),
        np.array(signs),
        reset_pose(robot),
        low,
        high,
        speed,
        tuple(table.start),
    )


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A,) lowest, highest angle [rad] and highest rate [rad/s]: the actions', the model's, the drives'."""
    from dynreg.sim.ports import nominal_ports

    low, high = command_limits(robot).T
    return low, high, nominal_ports(robot, 1).drive["speed_limit"][0]

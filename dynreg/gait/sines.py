"""The sinusoidal gait of a legged robot.

In leg l the joint of role j is told q_lj(t) = s_lj (o_j + A_j sin(2 pi f t + phi_l + psi_j)): one frequency f,
for every role an amplitude A, an offset o and a phase psi, for every leg but the first a phase phi. s is -1 for
mirrored joints. Three roles and four legs make the 13 genes of the paper.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from dynreg.gait.family import SCATTER, Family, Gene, of_robot
from dynreg.sim.gait_tables import GaitTable
from dynreg.sim.robot import Robot

# Draws about the pose at rest, as shares of the ranges: how far phases scatter (1 sigma), and the largest amplitude.
# Most of them fall, too, but searches that set out from the best end faster (bench_gait_search).
PHASES, LARGEST = 0.03, 0.35
ANY = 0.25  # of these draws whose legs have any phases: our own choice


@dataclass(frozen=True, eq=False, kw_only=True)
class Sines(Family):
    """Sinusoidal gaits.

    columns : (L, R) number of the action of every leg and role. signs : (L, R).
    """

    kind = "sines"
    told_by = GaitTable

    roles: tuple[str, ...]
    legs: tuple[str, ...]
    columns: np.ndarray
    signs: np.ndarray

    @classmethod
    def of(cls, robot: Robot, table: GaitTable) -> Self:
        genes = [Gene("frequency", "Hz", *table.frequency)]
        genes += [Gene(f"amplitude_{role.name}", "rad", *role.amplitude) for role in table.roles]
        genes += [Gene(f"offset_{role.name}", "rad", *role.offset) for role in table.roles]
        phases = [f"phase_{part.name}" for part in (*table.roles, *table.legs[1:])]
        genes += [Gene(name, "rad", -np.pi, np.pi, True) for name in phases]
        columns = [[robot.joints.index(leg.joints[role.name]) for role in table.roles] for leg in table.legs]
        signs = [[-1.0 if role.name in leg.mirrored else 1.0 for role in table.roles] for leg in table.legs]
        made = cls(
            **of_robot(robot, table, [joint for leg in table.legs for joint in leg.joints.values()]),
            ramp=table.ramp,
            genes=tuple(genes),
            roles=tuple(role.name for role in table.roles),
            legs=tuple(leg.name for leg in table.legs),
            columns=np.array(columns),
            signs=np.array(signs),
        )
        made.require_any(made._smallest)
        return made

    def frequency(self, genes: np.ndarray) -> float | None:
        return float(genes[0])

    @property
    def fastest(self) -> float:
        return self.bounds[0, 1]

    @property
    def amplitudes(self) -> slice:
        """Where the roles' amplitudes stand among the genes."""
        return slice(1, 1 + len(self.roles))

    @property
    def offsets(self) -> slice:
        """Where the roles' offsets stand among the genes."""
        return slice(1 + len(self.roles), 1 + 2 * len(self.roles))

    def about_rest(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, G) draws in the unit cube of gaits that swing a little about the pose at rest.

        Each leg is in phase with the first or against it, as in a trot, a pace or a bound; of a quarter of the draws
        it has any phase, as in a walk.
        """
        draws, roles, legs = rng.uniform(size=(count, len(self))), len(self.roles), len(self.legs) - 1
        rest = self.bounds.mean(axis=1)
        rest[self.offsets] = (self.signs * self.pose[self.columns]).mean(axis=0)
        draws[:, self.amplitudes] *= LARGEST
        draws[:, self.offsets] = self.to_unit(rest)[self.offsets] + SCATTER * rng.standard_normal(
            (count, roles)
        )
        against = 0.5 + 0.5 * rng.integers(0, 2, (count, legs)) + PHASES * rng.standard_normal((count, legs))
        free = rng.uniform(size=(count, 1)) < ANY
        draws[:, len(self) - legs :] = np.where(free, draws[:, len(self) - legs :], against)
        return self.inside(draws)

    def targets(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        roles, legs = len(self.roles), len(self.legs)
        frequency, amplitude, offset, phase, leg_phase = np.split(
            genes, np.cumsum([1, roles, roles, roles]), axis=1
        )
        leg_phase = np.concatenate([np.zeros((len(genes), 1)), leg_phase], axis=1)
        shift = leg_phase[:, :, None] + phase[:, None, :]  # (n, L, R)
        turn = 2 * np.pi * frequency * times  # (n, T)
        swing = amplitude[:, None, None] * np.sin(turn[:, :, None, None] + shift[:, None])
        joints = self.signs * (offset[:, None, None] + swing)  # (n, T, L, R)
        moving = np.tile(self.pose, (len(genes), len(times), 1))
        moving[..., self.columns.reshape(-1)] = joints.reshape(len(genes), len(times), roles * legs)
        return self.faded(moving, times)

    def feasible(self, genes: np.ndarray) -> np.ndarray:
        """(n, G) gaits as they are, where need be with offsets inside the joints' limits and nearer to rest, smaller
        amplitudes and, where the least amplitudes are still too fast, slower."""
        genes = np.clip(genes, *self.bounds.T)
        genes[:, 0] = np.minimum(genes[:, 0], self._steps_at_least)
        frequency, least = genes[:, :1], self.bounds[self.amplitudes, 0]
        speed, rest = self.speed[self.columns].min(axis=0), self.signs * self.pose[self.columns]
        reach = self.ramp * (speed - least * (2 * np.pi * frequency + 1.0 / self.ramp))
        low, high = self._centres
        low, high = np.maximum(low, rest.max(axis=0) - reach), np.minimum(high, rest.min(axis=0) + reach)
        offset = np.clip(genes[:, self.offsets], low, high)
        room = np.minimum(offset - self._role_limits[0], self._role_limits[1] - offset)
        rate = speed - self._reach(offset) / self.ramp
        most = np.minimum(room, rate / (2 * np.pi * frequency + 1.0 / self.ramp))
        genes[:, self.amplitudes] = np.clip(genes[:, self.amplitudes], least, np.maximum(most, least))
        genes[:, self.offsets] = offset
        return genes

    def problems(self, genes: np.ndarray) -> tuple[str, ...]:
        out = self.outside(genes)
        frequency, amplitude, offset = genes[0], genes[self.amplitudes], genes[self.offsets]
        fastest = amplitude * (2 * np.pi * frequency + 1 / self.ramp) + self._reach(offset) / self.ramp
        for leg, role in np.ndindex(*self.columns.shape):
            at = self.columns[leg, role]
            centre = self.signs[leg, role] * offset[role]
            out += self.past(at, centre - amplitude[role], centre + amplitude[role], fastest[role])
        return tuple(out)

    @cached_property
    def _role_limits(self) -> np.ndarray:
        """(2, R) lowest and highest angle that the joints of a role all can reach, before mirroring."""
        low, high = self.low[self.columns], self.high[self.columns]
        flipped = self.signs < 0
        return np.stack(
            [np.where(flipped, -high, low).max(axis=0), np.where(flipped, -low, high).min(axis=0)]
        )

    @cached_property
    def _centres(self) -> np.ndarray:
        """(2, R) lowest and highest offset of a role whose least amplitude all its joints can reach."""
        least, bounds = self.bounds[self.amplitudes, 0], self.bounds[self.offsets]
        low, high = self._role_limits
        return np.stack([np.maximum(bounds[:, 0], low + least), np.minimum(bounds[:, 1], high - least)])

    @cached_property
    def _smallest(self) -> np.ndarray:
        """(G,) the slowest gait with the least amplitudes, as near to the pose at rest as its legs can have it."""
        genes, rest = self.bounds[:, 0].copy(), self.signs * self.pose[self.columns]
        genes[self.offsets] = np.clip((rest.min(axis=0) + rest.max(axis=0)) / 2, *self._centres)
        return genes

    @cached_property
    def _steps_at_least(self) -> float:
        """The highest frequency [Hz] at which no role turns too fast in its least amplitude, as near to rest as can be;
        the lowest of the gene where there is none."""
        least, reach = self._smallest[self.amplitudes], self._reach(self._smallest[self.offsets])
        left = self.speed[self.columns].min(axis=0) - (reach + least) / self.ramp
        most = np.divide(left, 2 * np.pi * least, out=np.full(len(least), np.inf), where=least > 0)
        return max(float(most.min()), self.bounds[0, 0])

    def _reach(self, offset: np.ndarray) -> np.ndarray:
        """(..., R) how far [rad] the ramp takes the joints of a role from rest to their offset."""
        rest = self.signs * self.pose[self.columns]
        return np.abs(offset[..., None, :] - rest).max(axis=-2)

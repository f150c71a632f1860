"""Motions that are made once, through poses: from rest to one pose after the other, and back to rest.

The kick of Zagal and Ruiz-del-Solar is one: two poses of twelve joints, and how many points lie between two poses,
which is its speed: 25 genes.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from dynreg.errors import RobotError, quoted
from dynreg.gait.family import SLACK, Family, Gene, of_robot, ranged
from dynreg.gait.table import JointTable
from dynreg.sim.gait_tables import PosesTable
from dynreg.sim.robot import Robot

# s, from a pose to the next, usually. The paper prints no bounds of its count of points: these are our own choice.
LASTS = (0.05, 0.5)


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses(Family):
    """Motions through poses.

    columns : (M,) numbers of the actions that move. free : (M,) which of the free joints each follows. signs : (M,) -1
    where it turns the other way. rate : points a second [Hz].
    """

    kind = "poses"
    told_by = PosesTable

    poses: int
    columns: np.ndarray
    free: np.ndarray
    signs: np.ndarray
    rate: float

    @classmethod
    def of(cls, robot: Robot, table: PosesTable) -> Self:
        followed = {**table.together, **table.mirrored}
        free = list(table.joints or [name for name in robot.driven if name not in followed])
        signs = dict.fromkeys(free, 1.0) | dict.fromkeys(table.together, 1.0)
        signs |= dict.fromkeys(table.mirrored, -1.0)
        _check(robot, table, free, followed)
        common = of_robot(robot, table, signs)
        columns = [robot.joints.index(name) for name in signs]
        leaders = [free.index(followed.get(name, name)) for name in signs]
        made = cls(
            **common,
            ramp=0.0,
            genes=(),
            poses=table.poses,
            columns=np.array(columns),
            free=np.array(leaders),
            signs=np.array([*signs.values()]),
            rate=robot.rate,
        )
        bounds = made._limits()
        if not np.isfinite(bounds).all():
            lost = free[int(np.argwhere(~np.isfinite(bounds))[0, 0])]
            raise _unlike(
                robot, table, f"joint {lost!r} has no limits", "a range in the MJCF or of its action"
            )
        genes = [
            Gene(f"{name}_{p + 1}", "rad", *ends)
            for p in range(table.poses)
            for name, ends in zip(free, bounds, strict=True)
        ]
        genes.append(Gene("points", "1", *(seconds * robot.rate for seconds in LASTS)))
        genes = ranged(robot, tuple(genes), table)
        if (least := genes[-1].low) <= 0.0:
            raise _unlike(robot, table, f"points = [{least:g}, {genes[-1].high:g}]", "bounds above 0")
        made = cls(**{**vars(made), "genes": genes})
        made.require_any(made._smallest)
        return made

    def targets(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        knots, told = self.passed(genes)
        out = np.empty((len(genes), len(times), len(self.pose)))
        for i, at in np.ndindex(len(genes), len(self.pose)):
            out[i, :, at] = np.interp(times, knots[i], told[i, :, at])
        return out

    def table(self, genes: np.ndarray) -> JointTable:
        (times,), (told,) = self.passed(genes[None])
        return JointTable(None, times, told)

    def frequency(self, genes: np.ndarray) -> float | None:
        return None

    @property
    def fastest(self) -> float:
        return 0.0

    @property
    def rest(self) -> np.ndarray:
        """(G,) the pose at rest, every time."""
        own = np.empty(self.free.max() + 1)
        angles = self.signs * self.pose[self.columns]
        own[self.free[::-1]] = angles[::-1]  # joints that lead stand first, so theirs is written last
        return np.append(np.tile(own, self.poses), np.nan)

    def feasible(self, genes: np.ndarray) -> np.ndarray:
        """(n, G) motions as they are, where need be slower, and if that does not do, with poses nearer to rest."""
        genes = np.clip(genes, *self.bounds.T)
        genes[:, :-1] = np.clip(genes[:, :-1], *np.tile(self._limits(), (self.poses, 1)).T)
        needed, small, slowest = self._needed(genes), self._smallest, self.bounds[-1, 1]
        least, far = self._needed(small[None]), needed > slowest
        # what is needed grows no faster than along a line, on the way from the smallest motion
        nearer = ((slowest - least) / np.maximum(needed - least, SLACK))[:, None]
        genes[far, :-1] = (small[:-1] + nearer * (genes[:, :-1] - small[:-1]))[far]
        slow = needed > genes[:, -1]
        genes[slow, -1] = np.minimum(needed, slowest)[slow]
        return genes

    @property
    def _smallest(self) -> np.ndarray:
        """(G,) the slowest motion, through poses as near to rest as bounds and limits let them be."""
        out = np.clip(self.rest, *self.bounds.T)
        out[:-1] = np.clip(out[:-1], *np.tile(self._limits(), (self.poses, 1)).T)
        out[-1] = self.bounds[-1, 1]
        return out

    def problems(self, genes: np.ndarray) -> tuple[str, ...]:
        out = self.outside(genes)
        knots, told = self.passed(genes[None])
        rates = np.abs(np.diff(told[0], axis=0)) / np.diff(knots[0])[:, None]
        for at in self.columns:
            out += self.past(at, told[0, :, at].min(), told[0, :, at].max(), rates[:, at].max())
        return tuple(out)

    def passed(self, genes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (n, P+2) [s] and the joint angles (n, P+2, A) [rad] then, rest at both ends."""
        free = genes[:, :-1].reshape(len(genes), self.poses, self.free.max() + 1)
        told = np.tile(self.pose, (len(genes), self.poses + 2, 1))
        told[:, 1:-1, self.columns] = self.signs * free[:, :, self.free]
        return genes[:, -1:] / self.rate * np.arange(self.poses + 2), told

    def _needed(self, genes: np.ndarray) -> np.ndarray:
        """(n,) the fewest points between two poses at which no joint turns too fast."""
        told = self.passed(genes)[1]
        return self.rate * (np.abs(np.diff(told, axis=1)) / self.speed).max(axis=(1, 2))

    def _limits(self) -> np.ndarray:
        """(F, 2) between which a free joint and those that follow it all can turn [rad]."""
        ends = np.stack([self.low[self.columns], self.high[self.columns]], axis=1)
        ends = np.where(self.signs[:, None] < 0, -ends[:, ::-1], ends)
        out = np.tile([-np.inf, np.inf], (self.free.max() + 1, 1))
        np.maximum.at(out[:, 0], self.free, ends[:, 0])
        np.minimum.at(out[:, 1], self.free, ends[:, 1])
        return out


def _check(robot: Robot, table: PosesTable, free: list[str], followed: dict[str, str]) -> None:
    """RobotError where a joint is unknown, stands twice, or follows one that is not free."""
    every = [*free, *table.together, *table.mirrored]
    for name in (*every, *followed.values()):
        if name not in robot.joints:
            raise _unlike(
                robot, table, f"no action drives joint {name!r}", f"joints out of {quoted(robot.driven)}"
            )
    if twice := [name for i, name in enumerate(every) if name in every[:i]]:
        raise _unlike(robot, table, f"joint {twice[0]!r} stands twice", "each joint free, or following one")
    if lost := [leader for leader in followed.values() if leader not in free]:
        raise _unlike(robot, table, f"joint {lost[0]!r} is followed and not free", f"one of {free}")


def _unlike(robot: Robot, table: PosesTable, what: str, expected: str) -> RobotError:
    return RobotError(
        f"motion {table.name!r} of robot {robot.name!r}: {what}",
        expected=expected,
        do="correct [[motions]] in robot.toml",
    )

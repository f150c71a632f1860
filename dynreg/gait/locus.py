"""Gaits by the way of the feet: each foot runs round a closed locus, and the leg's kinematics tells the joints.

The 20 genes of the gait of Zagal and Ruiz-del-Solar. On the ground a foot goes straight back over `length`, at `speed`.
In the air it goes through five knots, joined by a Catmull-Rom spline: off the ground, lifted, highest, before the
descent, on the ground. `shape` leads from a rectangle (0) to a half ellipse (1). Legs across from each other step
together, as in a trot. `skew` is the curvature of the robot's way: the feet on the ground turn about its centre.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from dynreg.errors import RobotError, quoted
from dynreg.gait.family import SLACK, Family, Gene, of_robot, ranged
from dynreg.gait.leg import ROLES, Leg, legs_of
from dynreg.gait.swing import swung
from dynreg.gait.table import JointTable
from dynreg.sim.gait_tables import GaitTable
from dynreg.sim.robot import Robot

Fits = Callable[[np.ndarray], np.ndarray]  # which of some gaits (n, G) can be run, (n,)

FASTEST = 3.0  # Hz, of the steps of a leg; our own choice, as the paper prints none
# Points on the ground, between which joints turn evenly: the foot of an AIBO is then 0.05 mm off the line.
STANCE = 16
SAME = 1e-9  # s, between two points that are one
MISSED = 1e-7  # m, between a foot and where it should be, that counts as there
HALVINGS = 14  # of the way to a gait that can be run
ENDS = ("front", "rear")
# Usual bounds: shares of the leg's length, a second for `speed`; of an operating point, about the reset pose. The paper
# prints none: they are our own choice.
ABOUT = {"x": 0.35, "y": 0.15, "z": 0.25}
BOUNDS = {"length": (0.1, 0.8), "lift": (0.02, 0.35), "speed": (0.2, 3.0)}
# {gene: (above, below)}: outside, a foot would not go back, or the knots of the spline would not follow each other.
ALLOWED = {"speed": (0.0, np.inf), "air": (0.0, 1.0), "lift_time": (0.0, 0.5)}


@dataclass(frozen=True, eq=False, kw_only=True)
class Locus(Family):
    """Gaits of four legs by the way of the feet.

    legs : the four. columns : (4, 3) number of the action of every joint. front, left : (4,) where a leg is.
    """

    kind = "locus"
    told_by = GaitTable

    legs: tuple[Leg, ...]
    names_of_legs: tuple[str, ...]
    columns: np.ndarray
    front: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, robot: Robot, table: GaitTable) -> Self:
        if sorted(role.name for role in table.roles) != sorted(ROLES) or len(table.legs) != 4:
            told = f"{len(table.legs)} legs with roles {quoted(role.name for role in table.roles)}"
            raise _unlike(robot, told, f"four legs with the roles {quoted(ROLES)}")
        joints = [tuple(leg.joints[role] for role in ROLES) for leg in table.legs]
        legs = legs_of(robot, joints)
        hips = np.array([leg.hip for leg in legs])
        front, left = (hips[:, :2] > hips[:, :2].mean(axis=0)).T
        if len({*zip(front, left, strict=True)}) < 4:
            raise _unlike(robot, "legs that are not one at each corner", "four legs, one at each corner")
        genes = ranged(robot, _genes(legs, front, left), table)
        _require_sound(robot, genes)
        made = cls(
            **of_robot(robot, table, [joint for leg in table.legs for joint in leg.joints.values()]),
            ramp=table.ramp,
            genes=genes,
            legs=tuple(legs),
            names_of_legs=tuple(leg.name for leg in table.legs),
            columns=np.array([[robot.joints.index(name) for name in names] for names in joints]),
            front=front,
            left=left,
        )
        made.require_any(made._smallest)
        return made

    def targets(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        out = np.empty((len(genes), len(times), len(self.pose)))
        for i, one in enumerate(genes):
            out[i] = self.faded(self._steady(one, times), times)
        return out

    def table(self, genes: np.ndarray) -> JointTable:
        knots = self.ways(genes[None])[0][0]
        period = knots[-1]
        times = np.sort(np.concatenate([knots, np.mod(knots + period / 2, period)]))
        times = times[np.diff(times, prepend=-1.0) > SAME]
        times[-1] = period
        targets = self._steady(genes, times)
        targets[-1] = targets[0]
        return JointTable(period, times, targets)

    def frequency(self, genes: np.ndarray) -> float | None:
        return float(self._frequency(genes[None])[0])

    @property
    def fastest(self) -> float:
        return FASTEST

    @property
    def rest(self) -> np.ndarray:
        """(G,) the operating points and the skew of the reset pose."""
        return self.from_dict(dict.fromkeys(self.names, np.nan) | {"skew": 0.0} | self._standing)

    def feasible(self, genes: np.ndarray) -> np.ndarray:
        """(n, G) gaits as they are, where need be on smaller loci nearer to the pose at rest, and slower; where that is
        not enough, all their genes go toward the smallest gait."""
        genes, small = np.clip(genes, *self.bounds.T), self._smallest
        size = [self.names.index(name) for name in ("length", "lift", "skew", *self._standing)]
        pace, everything = [self.names.index("speed")], [*range(len(self))]
        genes = self._toward(genes, small, size, lambda g: self._fits(g, rates=False))
        genes = self._toward(genes, small, pace, lambda g: self._fits(g))
        genes = self._toward(genes, small, size, lambda g: self._fits(g))
        return self._toward(genes, small, everything, lambda g: self._fits(g))

    def problems(self, genes: np.ndarray) -> tuple[str, ...]:
        out = self.outside(genes)
        times, joints, missed = self._cycle(genes[None])
        for name, distance in zip(self.names_of_legs, missed[0], strict=True):
            if distance > MISSED:
                out.append(f"the foot of leg {name!r} would miss its way by {1000 * distance:.1f} mm")
        fastest = self._rates(times, joints)[0]
        for leg, role in np.ndindex(*self.columns.shape):
            at, told = self.columns[leg, role], joints[0, leg, :, role]
            out += self.past(at, told.min(), told.max(), fastest[leg, role])
        if (steps := self.frequency(genes)) > FASTEST + SLACK:
            out.append(f"each leg would step {steps:.2f} times a second, past {FASTEST:g}")
        return tuple(out)

    def ways(self, genes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (n, K) [s] of one period, and the points (n, 4, K, 3) of the feet at them [m]; the last is the first.

        The feet are in the frame of the body. Gaits with fewer points in the air repeat the last one.
        """
        g = dict(zip(self.names, genes.T[..., None], strict=True))  # each (n, 1)
        stance, air = self._stages(g)
        swing = np.minimum(np.arange(1, round(self.bounds[-1, 1]) + 1) / np.rint(g["points"]), 1.0)
        ground = np.arange(STANCE + 1) / STANCE
        times = np.concatenate([stance * ground, stance + air * swing], axis=1)
        back = np.broadcast_to(g["length"] * (0.5 - ground), (len(genes), STANCE + 1))
        points = []
        for leg, front, left in zip(self.legs, self.front, self.left, strict=True):
            end = ENDS[0 if front else 1]
            ahead, up = swung(g, end, swing)
            along = np.concatenate([back, ahead], axis=1)
            up = np.concatenate([np.zeros_like(back), up], axis=1)
            x = leg.hip[0] + g[f"{end}_x"]
            y = leg.hip[1] + (1.0 if left else -1.0) * g[f"{end}_y"]
            bent = (x + along * (1.0 - g["skew"] * y), y + along * g["skew"] * x)
            points.append(np.stack([*bent, leg.hip[2] + g[f"{end}_z"] + up], axis=-1))
        return times, np.stack(points, axis=1)

    @cached_property
    def _standing(self) -> dict[str, float]:
        """The operating points of the pose at rest."""
        return _standing(self.legs, self.front, self.left)

    @cached_property
    def _smallest(self) -> np.ndarray:
        """(G,) the gait whose joints turn least and slowest: low and round, at the pose at rest, long in the air."""
        low, high = (self.as_dict(ends) for ends in self.bounds.T)
        slow = low["speed"] * (1.0 - high["air"]) / FASTEST  # the shortest way that is not stepped too often
        length = np.clip(np.copysign(slow, high["length"]), low["length"], high["length"])
        standing = {n: np.clip(v, low[n], high[n]) for n, v in {"skew": 0.0, **self._standing}.items()}
        return self.from_dict(low | standing | {"length": length, "shape": high["shape"], "air": high["air"]})

    def _stages(self, g: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """How long a foot is on the ground and in the air [s]."""
        stance = np.abs(g["length"]) / g["speed"]
        return stance, stance * g["air"] / (1.0 - g["air"])

    def _frequency(self, genes: np.ndarray) -> np.ndarray:
        return 1.0 / sum(self._stages(dict(zip(self.names, genes.T, strict=True))))

    def _cycle(self, genes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (n, K) [s], joint angles (n, 4, K, 3) [rad], and how far (n, 4) each foot misses its way [m]."""
        times, points = self.ways(genes)
        joints = np.stack([leg.angles(points[:, i]) for i, leg in enumerate(self.legs)], axis=1)
        there = np.stack([leg.reaches(joints[:, i]) for i, leg in enumerate(self.legs)], axis=1)
        return times, joints, np.linalg.norm(there - points, axis=-1).max(axis=-1)

    def _steady(self, genes: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(T, A) joint angles of a gait (G,) at times (T,), without the ramp."""
        (knots,), (joints,), _ = self._cycle(genes[None])
        out = np.tile(self.pose, (len(times), 1))
        for leg, late in enumerate(np.where(self.front == self.left, 0.0, 0.5)):
            at = np.mod(times + late * knots[-1], knots[-1])
            for role, column in enumerate(self.columns[leg]):
                out[:, column] = np.interp(at, knots, joints[leg, :, role])
        return out

    def _rates(self, times: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """(n, 4, 3) the highest rate [rad/s] of each joint, the ramp's included."""
        lasts = np.diff(times)[:, None, :, None]
        rates = np.abs(np.diff(joints, axis=2)) / np.where(lasts > 0, lasts, np.inf)
        away = np.abs(joints - self.pose[self.columns][:, None])
        return (rates + np.maximum(away[:, :, 1:], away[:, :, :-1]) / self.ramp).max(axis=2)

    def _fits(self, genes: np.ndarray, *, rates: bool = True) -> np.ndarray:
        """(n,) whether the feet get everywhere within the joints' limits; and within those of `rates`, where asked."""
        times, joints, missed = self._cycle(genes)
        low, high = self.low[self.columns][:, None], self.high[self.columns][:, None]
        fits = (missed <= MISSED).all(axis=1)
        fits &= ((joints >= low - SLACK) & (joints <= high + SLACK)).all(axis=(1, 2, 3))
        if rates:
            fits &= (self._rates(times, joints) <= self.speed[self.columns] + SLACK).all(axis=(1, 2))
            fits &= self._frequency(genes) <= FASTEST + SLACK
        return fits

    def _toward(self, genes: np.ndarray, small: np.ndarray, columns: list[int], fits: Fits) -> np.ndarray:
        """(n, G) genes that fit as they are; of others, `columns` go toward `small` (G,) until they do."""
        wanted, known = genes[:, columns], fits(genes)
        low, high = known.astype(float), np.ones(len(genes))

        def moved(share: np.ndarray) -> np.ndarray:
            out = genes.copy()
            out[:, columns] = small[columns] + share[:, None] * (wanted - small[columns])
            out[known] = genes[known]
            return out

        for _ in range(0 if known.all() else HALVINGS):
            middle = np.where(known, 1.0, (low + high) / 2)
            good = fits(moved(middle))
            low, high = np.where(good, middle, low), np.where(good, high, middle)
        return moved(low)


def _standing(legs: Sequence[Leg], front: np.ndarray, left: np.ndarray) -> dict[str, float]:
    """Where the feet are from their hips in the reset pose [m], both of an end taken together; y outwards."""
    away = np.array([leg.reaches(leg.rest) - leg.hip for leg in legs])
    away[:, 1] *= np.where(left, 1.0, -1.0)
    means = {end: away[front == (end == "front")].mean(axis=0) for end in ENDS}
    return {f"{end}_{axis}": float(means[end][i]) for end in ENDS for i, axis in enumerate("xyz")}


def _genes(legs: Sequence[Leg], front: np.ndarray, left: np.ndarray) -> tuple[Gene, ...]:
    """The 20 genes with their usual bounds."""
    size = float(np.mean([leg.length for leg in legs]))
    scaled = {name: (size * low, size * high) for name, (low, high) in BOUNDS.items()}
    genes = [Gene("length", "m", *scaled["length"]), Gene("shape", "1", 0.0, 1.0)]
    genes += [Gene("lift", "m", *scaled["lift"])]
    genes += [Gene(f"{end}_{stage}", "1", 0.5, 1.5) for end in ENDS for stage in ("lift", "air", "descent")]
    for name, value in _standing(legs, front, left).items():
        reach = ABOUT[name[-1]] * size
        genes.append(Gene(name, "m", value - reach, value + reach))
    genes += [Gene("skew", "1/m", -2.0, 2.0), Gene("speed", "m/s", *scaled["speed"])]
    genes += [Gene("air", "1", 0.25, 0.6), Gene("lift_time", "1", 0.1, 0.4), Gene("points", "1", 4.0, 20.0)]
    return tuple(genes)


def _require_sound(robot: Robot, genes: tuple[Gene, ...]) -> None:
    """RobotError where the bounds of a gene hold a value with which no foot has a way."""
    for gene in genes:
        said = f"{gene.name} = [{gene.low:g}, {gene.high:g}]"
        above, below = ALLOWED.get(gene.name, (-np.inf, np.inf))
        if not above < gene.low < gene.high < below:
            expected = f"above {above:g}" if below == np.inf else f"above {above:g} and below {below:g}"
            raise _unlike(robot, said, f"bounds {expected}")
        if gene.name == "length" and gene.low <= 0.0 <= gene.high:
            raise _unlike(robot, f"{said}, in which 0 lies", "bounds above 0, or below it")
        if gene.name == "points" and gene.low < 1.0:
            raise _unlike(robot, said, "at least 1 point in the air")


def _unlike(robot: Robot, what: str, expected: str) -> RobotError:
    return RobotError(
        f"[gait] of robot {robot.name!r} is of kind 'locus': {what}",
        expected=expected,
        do="correct [gait] in robot.toml",
    )

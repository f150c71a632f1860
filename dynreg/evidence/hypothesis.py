"""Hypotheses: the plain model with one or more effects, and the coordinates in which they are fitted.

Coordinates are scaled so that a fit needs no further knowledge: nominal parameters in standard deviations of
their nameplate, sizes of effects in multiples of their medium size.
"""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from dynreg.sim.effects import EffectParameter, Term, applicable, placed
from dynreg.sim.effects.body import at_reset, body_at, carrier, driven_dofs, lever
from dynreg.sim.ports import largest_speeds, nominal_ports, servo_law
from dynreg.sim.robot import Robot
from dynreg.sim.sets import is_limit
from dynreg.sim.space import Parameter

FLAT = 1 / np.sqrt(12)  # standard deviation of a uniform prior, as a share of the range: by definition
# A logarithm would only bend the valleys in which causes trade off: with half of it bench_constants names 15 for 16 of
# 21, with twice the same.
NARROW = 0.3  # relative tolerance up to which there is none
WORTH = 0.5  # of the weak size, below which a cause is not worth a name: by contract
SMALLEST = 1e-3  # of the medium size: an effect that is there but does nothing; none may divide by zero
FACTOR = 3.0  # by which a shape changes over one coordinate: its prior, by definition
LIVELY = 10.0  # rad/s^2 of a motion that asks something of such a drive: as gravity does at a metre


@dataclass(frozen=True)
class Hypothesis:
    """The terms that act together; none for the plain model.

    given : how many of them, the first, are of the simulator that a search begins with: fitted, but not named.
    """

    terms: tuple[Term, ...] = ()
    given: int = 0

    @property
    def key(self) -> str:
        """ "load_friction", "backlash[fl_hip]+payload"; "" for the plain model."""
        return "+".join(term.key for term in self.terms)

    @property
    def keys(self) -> frozenset[str]:
        """Of its terms, whatever their order."""
        return frozenset(term.key for term in self.terms)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """The parameters of all its terms, in order."""
        return tuple(p for term in self.terms for p in term.effect.parameters)

    def columns(self, number: int) -> slice:
        """Where the effect coordinates of term `number` are."""
        begin = sum(len(term.effect.parameters) for term in self.terms[:number])
        return slice(begin, begin + len(self.terms[number].effect.parameters))

    def with_term(self, term: Term) -> "Hypothesis":
        """The hypothesis with one more term."""
        return Hypothesis((*self.terms, term), self.given)


class Coordinates:
    """Between fit coordinates and physical values, for one robot.

    Nominal coordinate i is (value - centre) / sigma, through the logarithm where the parameter's scale is "log" and
    its tolerance wide; sigma is its tolerance (relative to the nominal value, whatever the centre; of the range where
    the nominal value is 0), or that of a uniform prior over the range where nothing is known; `tolerance` widens (or
    narrows) all stated ones.
    Parameters that the log tells (the command rate) are fixed.
    """

    def __init__(
        self, robot: Robot, known: np.ndarray, centre: np.ndarray | None = None, tolerance: float = 1.0
    ):
        self.robot = robot
        self.tolerance = tolerance
        self.known = known
        space = robot.space
        self.centre = np.where(np.isnan(known), space.nominal if centre is None else centre, known)
        # without motor noise its parameter changes no rollout
        moving = [any(a.root != "control" or a.path != "noise" for a in s) for s in robot.setters]
        self.free = np.flatnonzero(np.isnan(known) & np.array(moving))
        stated = [_sigma(p, tolerance) for p in space.parameters]
        scale = np.array([p.scale == "log" for p in space.parameters])
        self.log = scale & (np.array(stated) > NARROW)
        self.sigma = np.where(scale & ~self.log, np.array(stated) * np.abs(self.centre), stated)

    def __len__(self) -> int:
        return len(self.free)

    def about(self, values: np.ndarray) -> "Coordinates":
        """The same parameters about another centre (P,)."""
        return Coordinates(self.robot, self.known, values, self.tolerance)

    def within(self, other: "Coordinates") -> tuple[np.ndarray, np.ndarray]:
        """(P',), (P',) begin and step of these coordinates in those of the same parameters about another centre.

        z of these is begin + step * z in the others.
        """
        begin = other.from_values(self.values(np.zeros(len(self))))
        ratio = np.where(self.log, 1.0, self.sigma / other.sigma)
        return begin, ratio[self.free]

    @cached_property
    def nominal_bounds(self) -> np.ndarray:
        """(P', 2) lowest and highest coordinates of the free parameters."""
        return np.stack([self.from_values(b) for b in self.robot.space.bounds.T], axis=1)

    def values(self, z: np.ndarray) -> np.ndarray:
        """(..., P) parameter values from free coordinates (..., P')."""
        full = np.zeros((*z.shape[:-1], len(self.centre)))
        full[..., self.free] = z
        linear = self.centre + self.sigma * full
        with np.errstate(over="ignore"):
            values = np.where(
                self.log, self.centre * np.exp(np.where(self.log, self.sigma * full, 0.0)), linear
            )
        low, high = self.robot.space.bounds.T
        return np.where(np.isnan(self.known), np.clip(values, low, high), self.known)

    def from_values(self, values: np.ndarray) -> np.ndarray:
        """(..., P') free coordinates of parameter values (..., P)."""
        safe = np.where(self.log, values, 1.0)
        z = np.where(self.log, np.log(safe / np.where(self.log, self.centre, 1.0)), values - self.centre)
        return (z / self.sigma)[..., self.free]

    def pulls(self, z: np.ndarray, tolerance: float = 1.0) -> np.ndarray:
        """(P',) how far free coordinates (P',) lie from the nameplate, in its sigma; NaN where it states none.

        Whatever these coordinates are about, and however wide their own sigma: `tolerance` is the factor on it here.
        """
        nameplate = Coordinates(self.robot, self.known, tolerance=tolerance)
        stated = np.isfinite([self.robot.space.parameters[i].tolerance for i in self.free])
        return np.where(stated, nameplate.from_values(self.values(z)), np.nan)

    @cached_property
    def scales(self) -> dict[str, np.ndarray]:
        """{quantity: (A,)} what sizes of effects are multiples of, for each drive, NaN for those that have no such; a
        planar base has no forces."""
        reach = largest_speeds(self.robot)
        if self.robot.planar:
            return {"1": np.ones(len(reach)), "command": reach}
        law = servo_law(nominal_ports(self.robot, 1), self.robot.input_defaults[None])
        model, data, driven = self.robot.model, at_reset(self.robot), driven_dofs(self.robot)
        # what a torque on each joint alone accelerates, with all other joints free to give way: in a chain less than
        # the joint's own entry of the inertia matrix, and what adds to it shows at once
        inverse = np.eye(model.nv)
        mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
        inertia = (1.0 / np.diag(inverse))[driven]
        limit = law.limit[0]
        unlimited = ~is_limit(limit)
        # a drive that states no limit: what it can be told, of one that is told a torque; else what gravity and a
        # lively motion ask for, next to which friction is large where links are light and gears are not
        moved = np.abs(data.qfrc_bias[driven]) + LIVELY * inertia
        told = law.gain[0] * largest_commands(self.robot)
        limit = np.where(unlimited, np.where((law.stiffness[0] == 0) & np.isfinite(told), told, moved), limit)
        ones = np.ones(len(limit))
        return {
            "1": ones,
            "torque": limit,
            "stiffness": np.divide(1.0, law.stiffness[0], out=np.nan * ones, where=law.stiffness[0] > 0),
            "inertia": inertia,
            "length": lever(self.robot, carrier(self.robot)) * ones,
            "mass": model.body_mass[carrier(self.robot)] * ones,
            "command": reach,
        }

    @property
    def drive_limits(self) -> np.ndarray:
        """(A,) what a disturbance of each drive is a share of: its torque limit, in a planar base its largest speed."""
        return self.scales["command" if self.robot.planar else "torque"]

    def scale(self, term: Term, parameter: EffectParameter) -> float:
        """What one medium size of this parameter is, in its unit.

        The mean over the term's joints, of those that have such a quantity; where none has, over the robot's.
        """
        if term.bodies and parameter.per == "length":
            return float(parameter.medium * lever(self.robot, body_at(self.robot, term.bodies)))
        at = self.robot.drives_of(term.joints)
        every = self.scales[parameter.per]
        own = every[at]
        return float(parameter.medium * np.nanmean(own if np.isfinite(own).any() else every))

    def effect_values(self, hypothesis: Hypothesis, z: np.ndarray) -> list[np.ndarray]:
        """Values (n, K) of each term from effect coordinates (n, sum K)."""
        out, at = [], 0
        for term in hypothesis.terms:
            columns = []
            for p in term.effect.parameters:
                scale, own = self.scale(term, p), z[:, at]
                if p.shape:
                    columns.append(scale * np.exp(np.log(FACTOR) * own))
                else:
                    columns.append(scale / np.maximum(own, SMALLEST) if p.inverse else scale * own)
                at += 1
            out.append(np.stack(columns, axis=1))
        return out

    def effect_coordinates(self, term: Term, values: np.ndarray) -> np.ndarray:
        """(K,) coordinates of one term's values (K,)."""
        out = []
        for p, value in zip(term.effect.parameters, values, strict=True):
            scale = self.scale(term, p)
            if p.shape:
                out.append(np.log(value / scale) / np.log(FACTOR))
            else:
                out.append(scale / value if p.inverse else value / scale)
        return np.array(out)


def largest_commands(robot: Robot) -> np.ndarray:
    """(A,) the largest size of each command that the robot states, in its unit; infinite where it states no range."""
    ends = [(a.low, a.high) for a in robot.file.actions]
    return np.array([np.inf if None in pair else max(np.abs(pair)) for pair in ends])


def shape_coordinate(parameter: EffectParameter, value: float) -> float:
    """The coordinate of a shape at a value [multiples of `per`]."""
    return float(np.log(value / parameter.medium) / np.log(FACTOR))


def effect_bounds(hypothesis: Hypothesis) -> np.ndarray:
    """(sum K, 2) lowest and highest effect coordinates."""
    rows = []
    for p in hypothesis.parameters:
        if p.shape:
            reach = np.log(p.most / p.medium) / np.log(FACTOR)
            rows.append((-reach, reach))
            continue
        most = p.medium / p.most if p.inverse else p.most / p.medium
        rows.append((-most if p.signed else SMALLEST, most))
    return np.array(rows).reshape(-1, 2)


def weak_coordinate(p: EffectParameter) -> float:
    """The coordinate of a parameter at its weak size."""
    return p.medium / p.weak if p.inverse else p.weak / p.medium


def worth_naming(hypothesis: Hypothesis, z: np.ndarray) -> bool:
    """Whether every term (coordinates (sum K,)) that is not given has half its weak size in a parameter of its own."""
    for number in range(hypothesis.given, len(hypothesis.terms)):
        own = zip(hypothesis.terms[number].effect.parameters, z[hypothesis.columns(number)], strict=True)
        if not any(abs(size) >= WORTH * weak_coordinate(p) for p, size in own if not (p.shape or p.shared)):
            return False
    return True


def single_terms(robot: Robot, only: tuple[str, ...] = (), without: tuple[str, ...] = ()) -> list[Term]:
    """Every effect that can act on the robot: on all its joints, and on each where it has several."""
    chosen = [
        e for name, e in applicable(robot).items() if (not only or name in only) and name not in without
    ]
    return [term for effect in chosen for term in placed(robot, effect)]


def _sigma(p: Parameter, tolerance: float) -> float:
    """Standard deviation of the parameter's prior, in its (logarithmic) coordinate."""
    if not np.isfinite(p.tolerance):
        return FLAT * (np.log(p.high / p.low) if p.scale == "log" else p.high - p.low)
    if p.scale == "log":
        return tolerance * p.tolerance
    return tolerance * p.tolerance * (abs(p.nominal) or p.high - p.low)

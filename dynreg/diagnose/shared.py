"""Coordinates that the fits to several recordings share: which are the same in all of them, and which differ.

`refit` says what stands for the likelihood, and what has a prior.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.refitted import Fitted, Refit, Value
from dynreg.diagnose.score import PER_PARAMETER
from dynreg.evidence.hypothesis import WORTH
from dynreg.evidence.interval import NINETY, NORMAL_90, prior_widths
from dynreg.evidence.point import clipped
from dynreg.sim.config import SimConfig, effects_of
from dynreg.sim.effects import Terms, unit_of

NARROWEST = 1e-12  # variance of a coordinate: no interval is a point
WIDE = 100.0  # standard deviations of a difference, in those of the nameplate: a difference that no log tells is 0


@dataclass(frozen=True)
class Axis:
    """One coordinate that all fits have: a parameter of the robot (its number), or one of a term of the hypothesis."""

    parameter: int | None = None
    term: int | None = None
    number: int = 0
    shape: bool = False


@dataclass(frozen=True, eq=False)
class Shared:
    """What recordings say of the coordinates (D,) that their fits share; those `apart` differ between recordings.

    precision : (R, D, D) and pull : (R, D) of the likelihood as a normal distribution: the prior is counted once, not
    with every recording. prior : (D,) its precision. nats : {axis: evidence that it differs}.
    """

    found: Mapping[str, Fitted]
    axes: tuple[Axis, ...]
    precision: np.ndarray
    pull: np.ndarray
    prior: np.ndarray
    apart: tuple[int, ...]
    nats: Mapping[int, float]

    @classmethod
    def of(cls, found: Mapping[str, Fitted]) -> "Shared":
        """Nothing differs yet."""
        fits = [*found.values()]
        terms = fits[0].point.hypothesis.terms
        free = set.intersection(*({*one.model.coordinates.free.tolist()} for one in fits))
        axes = [
            Axis(term=number, number=k, shape=p.shape)
            for number, term in enumerate(terms)
            for k, p in enumerate(term.effect.parameters)
        ]
        axes += [Axis(parameter=index) for index in sorted(free)]
        told = [_told(one, [_column(one, axis) for axis in axes]) for one in fits]
        columns = [_column(fits[0], axis) for axis in axes]
        prior = prior_widths(fits[0].point)[columns] ** -2.0  # the answer is its mean
        return cls(
            found, tuple(axes), np.array([p for p, _ in told]), np.array([p for _, p in told]), prior, (), {}
        )

    def parted(self, limit: float) -> "Shared":
        """Let coordinates differ one by one, the one with most evidence first, while that passes the limit."""
        now = self
        while True:
            before = now.solved(now.apart)[0]
            free = [i for i, axis in enumerate(self.axes) if not axis.shape and i not in now.apart]
            price = PER_PARAMETER * (len(self.pull) - 1)
            gained = {i: before - now.solved((*now.apart, i))[0] - price for i in free}
            now = replace(now, nats={**now.nats, **gained})
            best = max(free, key=lambda i: gained[i], default=None)
            if best is None or gained[best] < limit:
                return now
            now = replace(now, apart=(*now.apart, best))

    def solved(self, apart: tuple[int, ...]) -> tuple[float, np.ndarray, np.ndarray]:
        """With these coordinates apart: cost [nats], and every recording's values and standard deviations (R, D)."""
        logs, size = self.pull.shape
        common = [i for i in range(size) if i not in apart]
        width = len(common) + logs * len(apart)
        placed = np.zeros((logs, size, width))
        for r in range(logs):
            placed[r, common, range(len(common))] = 1.0
            own = len(common) + r * len(apart)
            placed[r, list(apart), range(own, own + len(apart))] = 1.0
        prior = np.zeros((width, width))
        prior[: len(common), : len(common)] = np.diag(self.prior[common])
        for k, axis in enumerate(apart):  # of the mean, and next to nothing of what differs from it
            own = len(common) + k + len(apart) * np.arange(logs)
            mean = np.full((logs, logs), 1.0 / logs)
            prior[np.ix_(own, own)] = self.prior[axis] * (mean / logs + (np.eye(logs) - mean) / WIDE**2)
        curvature = np.einsum("rdw,rde,rev->wv", placed, self.precision, placed) + prior
        pull = np.einsum("rdw,rd->w", placed, self.pull)
        inverse = np.linalg.inv(curvature)
        best = inverse @ pull
        return -0.5 * float(pull @ best), placed @ best, np.abs(placed) @ np.sqrt(np.diag(inverse))

    def simulators(self, answer: SimConfig) -> dict[str, SimConfig]:
        """By recording the simulator with the values that were found, those that are the same shared."""
        _, values, _ = self.solved(self.apart)
        out = {}
        for (name, one), own in zip(self.found.items(), values, strict=True):
            z = one.begin + one.step * one.point.z
            z[[_column(one, axis) for axis in self.axes]] = own
            point = clipped(one.frame, one.point, z)
            sizes = one.frame.effect_values(point.hypothesis, point.effect[None])
            effects = effects_of(Terms(point.hypothesis.terms, tuple(sizes)))
            parameters = one.model.robot.space.as_dict(one.frame.values(point.nominal))
            out[name] = replace(answer, values=parameters, effects=effects)
        return out

    def refit(self, axis: Axis) -> Refit:
        """What was found of one coordinate, in its unit.

        What differs is told with all else shared as it was found to be; what does not, by each recording alone.
        """
        at, scale = self.axes.index(axis), Scale.of(next(iter(self.found.values())), axis)
        _, value, sigma = self.solved(self.apart)
        middle, half = value[0, at], NORMAL_90 * sigma[0, at]
        if same := at not in self.apart:
            ends = {name: _ends(one, axis) for name, one in self.found.items()}
        else:
            rows = zip(self.found, value[:, at], NORMAL_90 * sigma[:, at], strict=True)
            ends = {name: (v, v - h, v + h) for name, v, h in rows}
        return Refit(
            scale.cause,
            scale.parameter,
            scale.unit,
            {name: scale.told(*three) for name, three in ends.items()},
            scale.told(middle, middle - half, middle + half),
            same,
            self.nats[at],
            tuple(name for name, three in ends.items() if scale.least is not None and scale.there(*three)),
            tuple(
                name for name, three in ends.items() if scale.least is not None and not scale.there(*three)
            ),
        )


@dataclass(frozen=True, eq=False)
class Scale:
    """What a coordinate is in its unit. least : below which a size is not worth naming; None for a parameter."""

    fitted: Fitted
    axis: Axis
    cause: str | None
    parameter: str
    unit: str
    least: float | None

    @classmethod
    def of(cls, fitted: Fitted, axis: Axis) -> "Scale":
        if axis.parameter is not None:
            own = fitted.model.robot.space.parameters[axis.parameter]
            return cls(fitted, axis, None, own.name, own.unit, None)
        term = fitted.point.hypothesis.terms[axis.term]
        p = term.effect.parameters[axis.number]
        least = WORTH * (p.medium / p.weak if p.inverse else p.weak / p.medium)
        return cls(fitted, axis, term.key, p.name, unit_of(fitted.model.robot, term, p), least)

    def there(self, value: float, low: float, high: float) -> bool:
        """Whether all of an interval is worth naming."""
        return not low <= 0 <= high and min(abs(low), abs(high)) >= self.least

    def told(self, value: float, low: float, high: float) -> Value:
        """A coordinate with its interval, in the unit."""
        middle, *ends = (self._one(z) for z in (value, low, high))
        return Value(middle, min(ends), max(ends))

    def _one(self, z: float) -> float:
        one, column = self.fitted, _column(self.fitted, self.axis)
        moved = one.begin + one.step * one.point.z
        moved[column] = z
        point = clipped(one.frame, one.point, moved)
        if self.axis.parameter is not None:
            return float(one.frame.values(point.nominal)[self.axis.parameter])
        values = one.frame.effect_values(point.hypothesis, point.effect[None])
        return float(values[self.axis.term][0, self.axis.number])


def _column(one: Fitted, axis: Axis) -> int:
    """Where a fit has a coordinate among its own."""
    if axis.parameter is not None:
        return int(np.flatnonzero(one.model.coordinates.free == axis.parameter)[0])
    return len(one.point.nominal) + one.point.hypothesis.columns(axis.term).start + axis.number


def _told(one: Fitted, columns: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(D, D), (D,) precision and pull of the likelihood of a fit, in the frame: without the fit's own prior.

    Its maximum is taken for the point, at which the fit's own prior no longer pulls; see `_unpulled`.
    """
    begin, step = one.begin[columns], one.step[columns]
    both = np.linalg.inv(_spread(one, columns) * np.outer(step, step))
    prior = (prior_widths(one.point)[columns] * step) ** -2.0
    middle = begin + step * one.point.z[columns]
    precision = _positive(both - np.diag(prior))
    return precision, precision @ middle


def _spread(one: Fitted, columns: list[int]) -> np.ndarray:
    """(D, D) mean square of the draws about the point, which a bound may hold at its end."""
    off = one.draws.z[:, columns] - one.point.z[columns]
    return np.einsum("n,nd,ne->de", one.draws.weights, off, off) + NARROWEST * np.eye(len(columns))


def _positive(precision: np.ndarray) -> np.ndarray:
    """(D, D) without what is below zero: draws scatter."""
    values, vectors = np.linalg.eigh(precision)
    return np.einsum("de,e,fe->df", vectors, np.maximum(values, 0.0), vectors)


def _ends(one: Fitted, axis: Axis) -> tuple[float, float, float]:
    """Value, low and high of one coordinate, in the frame."""
    column = _column(one, axis)
    low, high = one.draws.quantiles(one.draws.z[:, column], NINETY)
    value = one.point.z[column]
    ends = (float(value), float(min(low, value)), float(max(high, value)))
    return tuple(one.begin[column] + one.step[column] * z for z in ends)

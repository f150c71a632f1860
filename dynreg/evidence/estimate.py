"""Parameters of a term, in its units and with their intervals, from draws of the posterior."""

from dataclasses import dataclass

import numpy as np

from dynreg.evidence.gaussian import Gaussian, coordinates, correlations_of
from dynreg.evidence.hypothesis import Coordinates, Hypothesis, effect_bounds
from dynreg.evidence.interval import NINETY, NORMAL_90, Posterior
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.sim.effects import unit_of

EDGE = 1e-3  # of a coordinate: nearer to a bound is on it; no fit tells so little


@dataclass(frozen=True)
class Estimate:
    """A parameter of a term with its 90 % interval, in `unit`; the interval holds if the hypothesis is right.

    at_bound : the value lies on the edge of what a fit may reach. sizes : the weak, medium and strong size.
    """

    value: float
    low: float
    high: float
    unit: str
    at_bound: bool
    sizes: tuple[float, float, float]


def estimates(
    model: Model, point: Point, number: int, draws: Posterior, *, median: bool = False
) -> dict[str, Estimate]:
    """Parameters of the point's term `number` with 90 % intervals; `draws` are of the same hypothesis.

    median : give the posterior's, not the point's own values: along a valley the best point says nothing.
    """
    hypothesis, c, free = point.hypothesis, model.coordinates, len(point.nominal)
    own = hypothesis.columns(number)
    limits = bounds(c, hypothesis)[free:]
    value = c.effect_values(hypothesis, np.clip(point.effect, *limits.T)[None])[number][0]
    low, middle, high = draws.quantiles(
        c.effect_values(hypothesis, draws.z[:, free:])[number], (NINETY[0], 0.5, NINETY[1])
    )
    value = middle if median else value
    term, out = hypothesis.terms[number], {}
    for k, p in enumerate(term.effect.parameters):
        z, (least, most) = point.effect[own][k], limits[own][k]
        scale = c.scale(term, p) / p.medium
        out[p.name] = Estimate(
            value=float(value[k]),
            low=float(min(low[k], value[k])),
            high=float(max(high[k], value[k])),
            unit=unit_of(model.robot, term, p),
            at_bound=bool((z <= least + EDGE and (p.signed or p.shape)) or z >= most - EDGE),
            sizes=(p.weak * scale, p.medium * scale, p.strong * scale),
        )
    return out


def gaussian(c: Coordinates, point: Point, draws: Posterior, untold: tuple[str, ...] = ()) -> Gaussian:
    """The normal distribution with the 90 % intervals and the correlations of draws about a point: of its parameters,
    and of the sizes of its effects.

    As in `estimates`, an interval holds the point's own value. Coordinates run from 0 to 1 between the bounds of a fit.
    Weights are flattened where few draws carry them, so a correlation is uncertain by about 0.15. untold : names of
    parameters of which the recording tells nothing.
    """
    names, scales, limits = free_quantities(c, draws.hypothesis)

    def placed(z: np.ndarray) -> np.ndarray:
        values = [c.values(z[:, : len(c)])[:, c.free], *c.effect_values(draws.hypothesis, z[:, len(c) :])]
        return coordinates(scales, limits, np.clip(np.concatenate(values, axis=1), *limits.T))

    at, (own,) = placed(draws.z), placed(point.z[None])
    low, high = draws.quantiles(at)
    low, high = np.minimum(low, own), np.maximum(high, own)
    apart = at - draws.weights @ at
    return Gaussian(
        names=names,
        scales=scales,
        limits=limits,
        centre=(low + high) / 2,
        deviations=(high - low) / (2 * NORMAL_90),
        correlations=correlations_of((apart * draws.weights[:, None]).T @ apart),
        untold=untold,
    )


def free_quantities(
    c: Coordinates, hypothesis: Hypothesis
) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
    """Names (D,), scales (D,) and limits (D, 2) of free parameters and of the effects' sizes, as in `Gaussian`."""
    own = [c.robot.space.parameters[i] for i in c.free]
    sizes = [(term, p) for term in hypothesis.terms for p in term.effect.parameters]
    names = [p.name for p in own] + [f"{term.key}.{p.name}" for term, p in sizes]
    scales = [p.scale for p in own]
    scales += ["log" if p.shape else "inverse" if p.inverse else "linear" for _, p in sizes]
    ends = c.effect_values(hypothesis, effect_bounds(hypothesis).T)
    limits = [c.robot.space.bounds[c.free], *(np.sort(one.T, axis=1) for one in ends)]
    return tuple(names), tuple(scales), np.concatenate(limits)

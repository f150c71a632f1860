"""First order: what a term does at one size, and from that its best size and the nominal parameters beside it."""

import numpy as np

from dynreg.evidence.data import Sample
from dynreg.evidence.hypothesis import SMALLEST, effect_bounds, shape_coordinate
from dynreg.evidence.likelihood import mean_squares, objective
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.sim.effects import Term

# bench_constants names three of three legs in the air, with the same evidence, with SIZES of one and of five, and PULL
# of half and twice.
SIZES = (0.5, 1.0, 2.0)  # these times what the probe says is best
# As much friction again, and joints stick: so refined, the double pendulum's shoulder has more of it than its elbow, 92
# nats beside the first cause (bench_diagnose_double_pendulum).
REFINED = 0.2  # of the medium size, for probes of what acts on joints already
PULL = 3.0  # largest first change of a nominal coordinate
FOUND = 2  # values of a shape that go on: a count and, where the motion is short, its neighbour or its half


def probes(base: Point, term: Term, value: float | None = None) -> list[Point]:
    """`base` with the term at medium size, once for each size parameter alone; shapes at their typical value.

    value : of the shape that has values to try, instead of its typical one.
    An effect that already acts on some of these joints is probed at a smaller size.
    """
    hypothesis = base.hypothesis.with_term(term)
    parameters = term.effect.parameters
    same = [one.joints for one in base.hypothesis.terms if one.effect.id == term.effect.id]
    acting = any(not term.joints or not other or set(term.joints) & set(other) for other in same)
    size = REFINED if acting else 1.0
    low, high = effect_bounds(hypothesis)[-len(parameters) :].T
    shaped = [shape_coordinate(p, value) if value and p.tried else 0.0 for p in parameters]
    nothing = np.array(
        [z if p.shape or p.signed else SMALLEST for p, z in zip(parameters, shaped, strict=True)]
    )
    out = []
    for i, p in enumerate(parameters):
        if p.shape:
            continue
        z = nothing.copy()
        z[i] = size
        out.append(Point(hypothesis, base.nominal, np.concatenate([base.effect, np.clip(z, low, high)])))
    return out


class Linear:
    """The objective around a point, with a residual that is linear in all coordinates."""

    def __init__(self, model: Model, base: Point, residual: np.ndarray, slopes: np.ndarray, sample: Sample):
        self.model, self.base, self.residual, self.sample = model, base, residual, sample
        squares = mean_squares(residual[None], sample.data.floor)[0]
        weight = np.nan_to_num(sample.effective / squares) / max(residual.shape[1], 1)
        self.root = np.sqrt(np.broadcast_to(weight[:, None], residual.shape)).reshape(-1)
        self.flat = np.nan_to_num(slopes).reshape(len(slopes), -1) * self.root
        self.rest = np.nan_to_num(residual).reshape(-1) * self.root
        self.prior = base.prior
        self.slopes = slopes

    def starts(self, probes: list[Point], changes: np.ndarray) -> tuple[float, list[Point]]:
        """Objective at the best size, and points at `SIZES` times it. changes : (K, W, T, C) of the probes."""
        free = len(self.base.z)
        sized = [i for i, p in enumerate(probes[0].hypothesis.terms[-1].effect.parameters) if not p.shape]
        width = np.array([p.effect[len(self.base.effect) + i] for p, i in zip(probes, sized, strict=True)])
        scaled = np.nan_to_num(changes) / width[:, None, None, None]
        j = np.concatenate([self.flat, scaled.reshape(len(scaled), -1) * self.root])
        prior = np.concatenate([self.prior, np.zeros(len(sized))])
        curvature = j @ j.T + np.diag(prior + 1e-9)
        start = np.concatenate([self.base.z, np.zeros(len(sized))])
        best = np.linalg.lstsq(curvature, -j @ self.rest - prior * start, rcond=1e-12)[0]
        limits, own = bounds(self.model.coordinates, probes[0].hypothesis), [free + i for i in sized]
        out = []
        for share in SIZES:  # the other coordinates follow the size
            size = np.clip(share * best[free:], *limits[own].T)
            pull = -j[:free] @ (self.rest + size @ j[free:]) - self.prior * self.base.z
            move = np.linalg.lstsq(curvature[:free, :free], pull, rcond=1e-12)[0]
            move = np.clip(move, -PULL, PULL)
            z = probes[0].z.copy()
            z[:free] += move
            z[own] = size
            point = probes[0].moved(np.clip(z, *limits.T))
            after = self.residual + np.tensordot(size, scaled, 1) + np.tensordot(move, self.slopes, 1)
            out.append((float(objective([point], after[None], self.sample)[0]), point))
        return min(c for c, _ in out), [p for _, p in out]


def found_shapes(
    model: Model, base: Point, term: Term, sample: Sample, residual: np.ndarray, slope: np.ndarray
) -> Search[list[Point]]:
    """`base` with the term at the best of the values that its shape is to be tried at, each at several sizes.

    A count of cycles has an optimum beside every count that a fit cannot leave: each is probed, and judged to first
    order. residual : (W, T, C) of `base`. slope : (D, W, T, C) its derivatives. None for a term without such a shape.
    """
    values = [value for p in term.effect.parameters for value in p.tried]
    each = [probes(base, term, value) for value in values]
    if not each:
        return []
    made = yield from model.residuals([p for own in each for p in own], sample)
    linear, width = Linear(model, base, residual, slope, sample), len(each[0])
    found = [linear.starts(own, made[width * i : width * (i + 1)] - residual) for i, own in enumerate(each)]
    order = sorted(range(len(found)), key=lambda i: found[i][0])
    return [point for i in order[:FOUND] for point in found[i][1]]

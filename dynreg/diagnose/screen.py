"""Screen: the gain of every term at several sizes, with the nominal parameters refitted to first order."""

from collections.abc import Sequence

import numpy as np

from dynreg.diagnose.linear import found_shapes
from dynreg.evidence.data import Sample
from dynreg.evidence.hypothesis import Hypothesis, effect_bounds
from dynreg.evidence.likelihood import information, log_likelihood, mean_squares
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, clipped
from dynreg.evidence.slopes import sensitivities
from dynreg.sim.effects import Term

# bench_constants names 16 of 21: with one size 15, with half and twice of the three 16; with one start kept 15, with
# four 16; FAR anything from 5 to 20. Three sizes, and either sign, are so by contract.
SCREEN = (0.3, 1.0, 2.5)  # sizes that the screening tries, in medium sizes
FAR = 10.0  # standard deviations that a start's nominal coordinates may be moved
KEPT = 2  # starts of each hypothesis that are refitted by one iteration


def screen(
    model: Model, base: Point, terms: Sequence[Term], sample: Sample, hints: Sequence[Point] = ()
) -> Search[tuple[list[Point], np.ndarray]]:
    """The most promising starts of every term, and the derivatives (D, W, T, C) at `base`.

    hints : `base` with one of the terms each, at a size to try besides.

    Several sizes and signs are tried, and the values of a shape that a fit cannot walk to. The nominal coordinates are
    refitted to first order, so only the part of a term's change counts that they cannot explain.
    """
    residual, (slope,) = yield from sensitivities(model, [base], sample)
    starts = []
    for term in terms:
        own = [np.concatenate([base.effect, z]) for z in _starts(term)]
        shaped = yield from found_shapes(model, base, term, sample, residual[0], slope)
        starts.append([*own, *(point.effect for point in shaped)])
    of = np.repeat(np.arange(len(terms)), [len(own) for own in starts])  # the number of each one's term
    tried = [
        Point(base.hypothesis.with_term(term), base.nominal, effect)
        for term, own in zip(terms, starts, strict=True)
        for effect in own
    ]
    numbers = {term.key: number for number, term in enumerate(terms)}
    tried += hints
    of = np.append(of, [numbers[p.hypothesis.terms[-1].key] for p in hints]).astype(int)
    made = yield from model.residuals(tried, sample)
    gains, moves = _with_moves(base, residual, slope, made, sample)
    out = []
    for number in range(len(terms)):
        own = np.flatnonzero(of == number)
        for i in own[np.argsort(-gains[own])[:KEPT]]:
            z = tried[i].z.copy()
            z[: len(moves[i])] += np.clip(moves[i], -FAR, FAR)
            out.append(clipped(model.coordinates, tried[i], z))
    return out, slope


def _with_moves(
    base: Point, residual: np.ndarray, slope: np.ndarray, made: np.ndarray, sample: Sample
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Log-likelihood (n,) of residuals `made` (n, W, T, C) after the best move (D,) of the base's coordinates."""
    floor = sample.data.floor
    curvature, _ = information(base, residual[0], slope, sample)
    weight = np.nan_to_num(sample.effective / mean_squares(residual, floor)[0]) / max(residual.shape[2], 1)
    inverse = np.linalg.pinv(curvature)  # coordinates at a bound may do nothing
    flat = np.nan_to_num(slope).reshape(len(slope), -1)
    weights = np.broadcast_to(weight[:, None], residual.shape[1:]).reshape(-1)
    gains, moves = np.empty(len(made)), []
    for i in range(len(made)):
        new = np.nan_to_num(made[i]).reshape(-1)
        pull = -(flat * weights) @ new - base.prior * base.z
        move = inverse @ pull
        after = new + flat.T @ move
        # the size of the residual is unknown: gains count by the logarithm, as in the objective
        price = 0.5 * base.prior @ (base.z + move) ** 2
        squares = mean_squares(after.reshape(1, *residual.shape[1:]), floor)
        gains[i] = float(log_likelihood(squares, sample.effective)[0]) - price
        moves.append(move)
    return gains, moves


def _starts(term: Term) -> list[np.ndarray]:
    """Effect coordinates to try: some sizes, both signs where it has one; shapes at their typical value."""
    parameters = term.effect.parameters
    low, high = effect_bounds(Hypothesis((term,))).T
    sized = [i for i, p in enumerate(parameters) if not p.shape]
    out = []
    for size in SCREEN:
        signs = [[1.0]]
        if parameters[0].signed:
            # two signed parameters (a phase): four quadrants
            both = len(sized) > 1 and parameters[sized[1]].signed
            signs = [[a, b] for a in (1.0, -1.0) for b in (1.0, -1.0)] if both else [[1.0], [-1.0]]
        for sign in signs:
            z = np.zeros(len(parameters))
            for k, i in enumerate(sized):
                z[i] = size * (sign[k] if k < len(sign) else 1.0)
            out.append(np.clip(z, low, high))
    return out

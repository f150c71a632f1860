"""Draws: simulators that carry one effect or none, drawn about a model's start."""

from collections.abc import Sequence

import numpy as np

from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, clipped
from dynreg.rng import stream
from dynreg.sim.effects import EffectParameter, Term

# A robot is drawn within so many sigma of its nameplate, as hidden robots are (`evidence.truth`).
WITHIN = 2.5
# Sizes reach from this share of the weak one to so many strong ones: no smaller one is worth a name, and beyond the
# strong one users are few.
LEAST, MOST = 0.5, 1.5
# Of the sizes of one effect each is drawn about a common one, by up to the root of this factor to either side.
APART = 2.0
NONE_OF = 5  # one entry in so many carries nothing: these tell the noise, in as many directions as there are of them


def drawn(model: Model, terms: Sequence[Term], numbers: Sequence[int], seed: int) -> list[Point]:
    """The entries `numbers`, each with a robot of its own: one in `NONE_OF` without any term, the others with one.

    Sizes are uniform in their logarithm, signs are even, shapes and parameters come from their priors. An entry does
    not depend on the others.
    """
    return [_drawn(model, carried(terms, i), stream(seed, "one effect", i)) for i in numbers]


def carried(terms: Sequence[Term], number: int) -> Term | None:
    """The term of entry `number`; None where it has none."""
    turn, own = divmod(number, NONE_OF)
    return terms[(turn * (NONE_OF - 1) + own - 1) % len(terms)] if own else None


def _drawn(model: Model, term: Term | None, rng: np.random.Generator) -> Point:
    start, nominal = model.start, _parameters(model.coordinates, rng)
    common, own = rng.uniform(), []
    for p in term.effect.parameters if term else ():
        own.append(rng.uniform(-1.0, 1.0) if p.shape else _size(p, common, rng))
    hypothesis = start.hypothesis.with_term(term) if term else start.hypothesis
    point = Point(hypothesis, nominal, np.concatenate([start.effect, own]))
    return clipped(model.coordinates, point, point.z)


def _parameters(coordinates: Coordinates, rng: np.random.Generator) -> np.ndarray:
    """(P',) coordinates: normal within the tolerances, uniform over the range where nothing is known."""
    known = np.clip(rng.standard_normal(len(coordinates)), -WITHIN, WITHIN)
    anywhere = rng.uniform(*coordinates.nominal_bounds.T)
    every = coordinates.robot.space.parameters
    stated = np.array([np.isfinite(every[i].tolerance) for i in coordinates.free], dtype=bool)
    return np.where(stated, known, anywhere)


def _size(p: EffectParameter, common: float, rng: np.random.Generator) -> float:
    """The coordinate of a size, `common` (0 to 1) of the way from the least to the most in its logarithm."""
    share = lambda size: p.medium / size if p.inverse else size / p.medium  # noqa: E731
    least, most = np.log(LEAST * share(p.weak)), np.log(MOST * share(p.strong))
    beside = 0.5 * np.log(APART) * rng.uniform(-1.0, 1.0)
    sign = rng.choice([-1.0, 1.0]) if p.signed else 1.0
    return float(sign * np.exp(least + common * (most - least) + beside))

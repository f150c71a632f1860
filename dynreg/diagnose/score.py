"""Score: the evidence of each hypothesis over the model without its last term, and the equivalents of the best."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import worth_naming
from dynreg.evidence.likelihood import log_likelihood, mean_squares
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.sim.effects import Term

# The price of a parameter, 5 % and 15 nats are by contract: they won a comparison of four ways to name causes.
# bench_constants names 16 of 21 with FEW and BEYOND halved and doubled.
PER_PARAMETER = 2.0  # nats: the price of a parameter of an effect
NEAR = 0.05  # share of the best score (but at least FEW nats) within which fewer parameters are preferred
FEW = 3.0
BEYOND = 5.0  # nats that fit may gain beyond twice the gain on select: more is fitted noise
INSTEAD = 0.5  # of a cause's evidence, from which on parameters could stand in for it: by definition
NATS = 15.0  # nats (or the share NEAR) within which hypotheses count as equal


Gained = Callable[
    [Data, np.ndarray], np.ndarray
]  # residuals (n, W, T, C) -> (n,) log-likelihood on the first


@dataclass(frozen=True)
class Scored:
    """A fitted hypothesis: its point, and its evidence [nats] over the model without its last term."""

    point: Point
    nats: float

    @property
    def key(self) -> str:
        return self.point.hypothesis.key

    @property
    def term(self) -> Term:
        """What it adds: the last term."""
        return self.point.hypothesis.terms[-1]


@dataclass(frozen=True)
class Naming:
    """One round: its start, the ranking, the chosen hypothesis and its equivalents.

    needed : evidence [nats] that a cause must have; 0 where that is not known yet. small : ids of effects that were
    fitted and left out of the ranking, as their sizes are below half the weak ones.
    """

    start: Scored
    ranking: tuple[Scored, ...]
    chosen: Scored | None = None
    equivalent: tuple[Scored, ...] = ()
    small: tuple[str, ...] = ()
    needed: float = 0.0

    @property
    def as_good(self) -> tuple[Scored, ...]:
        """The equivalents that a cause could be: what has less evidence than chance may give explains nothing."""
        return tuple(s for s in self.equivalent if s.nats >= self.needed)

    @property
    def most(self) -> float:
        """The most evidence [nats] of all hypotheses of which one may be chosen; 0 without any."""
        return 0.0 if self.chosen is None else max(s.nats for s in self.ranking)


def confirmed(data: Data, residuals: np.ndarray) -> np.ndarray:
    """(n,) gain of log-likelihood over the first, from residuals (n, W, T, C) on the fit and select parts.

    The gain on the fit part counts only as far as the select part confirms it.
    """
    squares = mean_squares(residuals, data.floor)
    rough = np.array([np.nansum(np.log(s)) for s in squares])
    effective = data.effective(residuals[int(rough.argmin())])
    first = len(data.fit) * data.segments
    gained = [log_likelihood(squares[:, w], effective[w]) for w in (slice(None, first), slice(first, None))]
    on_fit, on_select = (g - g[0] for g in gained)
    return np.minimum(on_fit, 2.0 * np.maximum(on_select, 0.0) + BEYOND) + on_select


def by_either(data: Data, residuals: np.ndarray) -> np.ndarray:
    """(n,) gain of log-likelihood over the first, with the independent samples of its own residual or of the first's.

    All hypotheses were fitted on all windows, so no held-out part confirms a gain; only the threshold guards against
    chance. The smaller of the two counts: with slipping contacts the weights of the windows alone change gains by 100
    nats.
    """
    squares = mean_squares(residuals, data.floor)
    samples = [data.effective(r) for r in residuals]
    gains = []
    for square, own in zip(squares, samples, strict=True):
        pair = np.stack([squares[0], square])
        gains.append(min(float(np.diff(log_likelihood(pair, e))[0]) for e in (samples[0], own)))
    return np.array(gains)


def score(
    model: Model, data: Data, base: Point, fitted: Sequence[Point], gained: Gained = confirmed
) -> Search[Naming]:
    """Score on fit and select, drop effects below half their weak size, prefer fewer parameters among equals.

    gained : the rule that counts gains of the log-likelihood, `confirmed` or `by_either`.
    """
    residuals = yield from model.residuals([base, *fitted], data.sample(data.both))
    likelihood = gained(data, residuals)
    best: dict[str, Scored] = {}
    small: dict[str, None] = {}
    for i, point in enumerate(fitted, start=1):
        more = len(point.effect) - len(base.effect)
        nats = likelihood[i] - PER_PARAMETER * more - (point.penalty - base.penalty)
        if not worth_naming(point.hypothesis, point.effect):
            small[point.hypothesis.terms[-1].effect.id] = None
            continue
        scored = Scored(point, float(nats))
        if scored.key not in best or best[scored.key].nats < scored.nats:
            best[scored.key] = scored
    named = chosen(Scored(base, 0.0), tuple(sorted(best.values(), key=lambda s: -s.nats)))
    return replace(named, small=tuple(small))


def chosen(start: Scored, ranking: tuple[Scored, ...], needed: float = 0.0) -> Naming:
    """The best of a ranking (or one about as good with fewer parameters), and its equivalents.

    needed : evidence [nats] that the chosen one must have where the best has it.
    """
    if not ranking or ranking[0].nats <= 0:
        return Naming(start, ranking)
    top = ranking[0].nats
    least = max(top - max(NEAR * top, FEW), needed if needed <= top else 0.0)
    near = [s for s in ranking if s.nats >= least]
    best = min(near, key=lambda s: (len(s.point.effect), -s.nats))
    within = max(NEAR * top, NATS)
    equal = tuple(s for s in ranking if s.nats >= top - within and s is not best)
    return Naming(start, ranking, best, equal)


def lowered(naming: Naming, less: Mapping[str, float]) -> Naming:
    """The naming with so many nats less for the hypotheses of these keys, and chosen again."""
    ranking = [replace(s, nats=s.nats - less.get(s.key, 0.0)) for s in naming.ranking]
    again = chosen(naming.start, tuple(sorted(ranking, key=lambda s: -s.nats)))
    return replace(again, small=naming.small)


def passing(naming: Naming, needed: float) -> Naming:
    """The naming, with fewer parameters preferred among those alone that have the evidence [nats] which a cause needs.

    One that fails would else be chosen in the place of one that passes, and no cause be named.
    """
    if naming.chosen is None or naming.chosen.nats >= needed:
        return naming
    return replace(chosen(naming.start, naming.ranking, needed), small=naming.small)

"""Guide: what a search for causes takes from a population under the same commands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.ranking.features import Frame
from dynreg.diagnose.ranking.population import EffectPopulation, Ranking
from dynreg.evidence.data import Data
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.sim.effects import Term

# Causes that a search tries first, and of each the sizes of so many of its nearest entries. On the servo bench the
# hidden cause is among the first five for all of medium and strong size and for 94 % of the weak ones.
FIRST, SIZES = 5, 2


@dataclass(frozen=True, eq=False)
class Guide:
    """A population under the commands of a log."""

    population: EffectPopulation

    def ranking(self, model: Model, data: Data, terms: Sequence[Term]) -> Search[Ranking]:
        """What a log looks like, among these terms, by what the model's start leaves of it."""
        if model.start.hypothesis.keys not in model.corrections:
            model = yield from model.corrected([model.start], data)
        frame = yield from Frame.of(model, data)
        (feature,) = yield from frame.features(frame.sample.measured[None])
        return self.population.ranked(feature, [t.key for t in terms])

    def left(self, model: Model, point: Point, data: Data, terms: Sequence[Term]) -> Search[Ranking]:
        """What a point leaves of a log looks like, among these terms."""
        feature = yield from Frame.left(model, point, data)
        return self.population.ranked(feature, [t.key for t in terms])

    def hints(self, ranking: Ranking, model: Model, base: Point, terms: Sequence[Term]) -> list[Point]:
        """`base` with each of the first causes of a ranking, at the sizes of its nearest entries."""
        named, out = {t.key: t for t in terms}, []
        own, begin = self.population, len(base.nominal) + len(model.start.effect)
        for key in [key for key in ranking.keys if key in named][:FIRST]:
            hypothesis = base.hypothesis.with_term(named[key])
            members = np.flatnonzero(own.carried == own.terms.index(key))
            near = members[np.argsort(-ranking.cosines[members], kind="stable")[:SIZES]]
            width = len(named[key].effect.parameters)
            for row in own.points[near]:
                z = np.concatenate([base.z, row[begin : begin + width]])
                point = Point(hypothesis, base.nominal, z[len(base.nominal) :])
                out.append(point.moved(np.clip(z, *bounds(model.coordinates, hypothesis).T)))
        return out

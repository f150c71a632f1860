"""Model: a robot with coordinates in which it is fitted; points in, residuals of a recording out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from dynreg.evidence.accuracy import PLAIN, Accuracy
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.hypothesis import Coordinates, Hypothesis, effect_bounds
from dynreg.evidence.lockstep import Ask, Search, ask, together
from dynreg.evidence.many import MANY
from dynreg.evidence.point import Point
from dynreg.replay.residual import scaled
from dynreg.sim.effects import Terms, stacked
from dynreg.sim.engines import Case
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

# Half and twice change nothing where nothing is chaotic: bench_constants names and tells the same to the digit.
MOST = 0.5  # of the spread: a larger difference of the finer time step is chaos, no error of first order
NONE: Mapping[frozenset[str], np.ndarray] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Model:
    """What is held against a recording: a robot, the coordinates of its fits, and how exactly it is simulated.

    begun : effects of the simulator that a search begins with, of one row; None without.
    finely : the robot's own time step over that of the model's rollouts; 1 for the same.
    corrections : {keys of terms: (W, T, C)} what a finer time step changes in the rollouts of a hypothesis near some
        point, in units of the spread, by the number of the window.
    """

    robot: Robot
    coordinates: Coordinates
    engine: str | None = None
    begun: Terms | None = None
    accuracy: Accuracy = PLAIN
    finely: float = 1.0
    corrections: Mapping[frozenset[str], np.ndarray] = field(default_factory=lambda: NONE, repr=False)

    @property
    def start(self) -> Point:
        """The simulator that a search begins with: its effects, as far as a fit reaches, and no parameter moved."""
        terms, values = (self.begun.terms, self.begun.values) if self.begun else ((), ())
        hypothesis = Hypothesis(terms, given=len(terms))
        sizes = [self.coordinates.effect_coordinates(t, row[0]) for t, row in zip(terms, values, strict=True)]
        effect = np.clip(np.concatenate([np.zeros(0), *sizes]), *effect_bounds(hypothesis).T)
        return Point(hypothesis, np.zeros(len(self.coordinates)), effect)

    @property
    def running(self) -> str:
        """The engine that rollouts run on."""
        return self.robot.running(self.engine)

    @property
    def dear(self) -> bool:
        """Whether most of a search would go into derivatives: rough rollouts, and many parameters."""
        return self.accuracy.sides > 1 and len(self.coordinates) > MANY

    @property
    def fine(self) -> "Model":
        """The model by which what counts in the end is judged: most often this one."""
        accuracy = self.accuracy
        return replace(self, finely=accuracy.finer, corrections=NONE) if accuracy.fine else self

    @property
    def sloped(self) -> "Model":
        """The model by whose rollouts derivatives are taken: most often this one."""
        if self.finely == 1.0 or self.finely == self.accuracy.slopes:
            return self
        return replace(self, finely=self.accuracy.slopes)

    def states(self, points: Sequence[Point], run: Run) -> Search[np.ndarray]:
        """(n, E, T+1, S) rollouts of the points through the episodes of a run."""
        robot = self.robot if self.finely == 1.0 else _stepped(self.robot, self.finely)
        values = self.coordinates.values(np.array([p.nominal for p in points]))
        return ask(Ask(robot, Case(values, run, self._terms(points)), self.engine))

    def residuals(self, points: Sequence[Point], sample: Sample) -> Search[np.ndarray]:
        """(n, W, T, C) simulated - measured, in units of the channels' spread; NaN where nothing was measured.

        See `residual.scaled`.
        """
        data = sample.data
        states = yield from self.states(points, data.windows.run.take(sample.chosen))
        correction = None
        if self.corrections:
            correction = np.array([self._correction(p.hypothesis)[sample.chosen] for p in points])
        states = states[..., 1:, data.use]
        return data.cut(scaled(states, sample.measured, data.spread, correction))

    def corrected(self, points: Sequence[Point], data: Data) -> Search["Model"]:
        """The model with what its time step does to the rollouts of these points taken off all of their hypotheses.

        MuJoCo's integrator is of first order: half a time step late looks like a soft joint. That of the joint engine
        is of second order, yet delays and speed limits are found more precisely than that. So is that of wheels,
        where commands lag or a wheel slips; else it is exact. Rollouts with a time step `accuracy.finer` times finer
        say by how much (contacts follow no order: nothing is extrapolated). Of the windows to fit and to select by: no
        other residual is looked at. A model that is `finely` simulated stays as it is.
        """
        if self.accuracy.finer == 1.0 or self.finely > 1.0:
            return self
        run, finer = data.windows.run.take(data.both), replace(self, finely=self.accuracy.finer)
        fine, own = yield from together([finer.states(points, run), self.states(points, run)])
        # what is left of an error of this order in the finer rollouts is extrapolated, too (L. Richardson, 1911)
        power = self.accuracy.finer**self.accuracy.order
        whole = 1.0 if self.accuracy.fine else power / (power - 1.0)
        change = whole * (fine - own)[..., 1:, data.use] / data.spread
        found = dict(self.corrections)
        for point, of_point in zip(points, change, strict=True):
            known = np.zeros((len(data.windows), *of_point.shape[1:]))
            known[data.both] = np.clip(np.nan_to_num(of_point), -MOST, MOST)
            found[point.hypothesis.keys] = known
        return replace(self, corrections=MappingProxyType(found))

    def _correction(self, hypothesis: Hypothesis) -> np.ndarray:
        """(W, T, C) of the hypothesis, else of the one that it extends by a term."""
        for terms in (hypothesis.terms, hypothesis.terms[:-1], ()):
            known = self.corrections.get(Hypothesis(terms).keys)
            if known is not None:
                return known
        return next(iter(self.corrections.values())) * 0.0

    def _terms(self, points: Sequence[Point]) -> Terms | None:
        """The terms of all points, NaN where a point does not have one."""
        groups: dict[tuple, list[int]] = {}
        for i, point in enumerate(points):
            groups.setdefault(point.hypothesis.terms, []).append(i)
        parts = []
        for terms, members in groups.items():
            z = np.array([points[i].effect for i in members])
            values = self.coordinates.effect_values(points[members[0]].hypothesis, z)
            parts.append((members, Terms(terms, tuple(values))))
        return stacked(len(points), parts)


@lru_cache(maxsize=64)  # its model is compiled once for all that ask
def _stepped(robot: Robot, finer: float) -> Robot:
    return robot.stepped(finer)

"""The data of one diagnosis and what a hypothesis makes of it: batched rollouts, residuals, likelihood."""

import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dynreg.diagnose.hypothesis import Coordinates, Hypothesis, effect_bounds
from dynreg.replay.jitter import CANDIDATES, jitter
from dynreg.replay.residual import scaled
from dynreg.replay.samples import effective_samples
from dynreg.replay.windows import Windows
from dynreg.sim.effects import Terms, stacked
from dynreg.sim.engine import ENGINES
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot

FLOOR = 0.25  # of the stated sensor noise variance: no residual counts as smaller
FINER_STANDING = 4  # times, of a floating base on its feet, whose slips a finer one tells no better;
SLOPING = 2  # times as long a step as that is fine enough for their derivatives
SEGMENT = 0.6  # s of a rollout of a robot on its feet that share a variance
MOST = 0.5  # of the spread: a larger difference is chaos, no error of first order


@dataclass(frozen=True)
class Point:
    """One candidate: a hypothesis, its nominal coordinates (P',) and its effect coordinates (K,)."""

    hypothesis: Hypothesis
    nominal: np.ndarray
    effect: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """(P' + K,) all coordinates."""
        return np.concatenate([self.nominal, self.effect])

    def moved(self, z: np.ndarray) -> "Point":
        """The point of the same hypothesis at coordinates z (P' + K,)."""
        return Point(self.hypothesis, z[: len(self.nominal)], z[len(self.nominal) :])

    @property
    def prior(self) -> np.ndarray:
        """(P' + K,) the prior's curvature: 1 for nominal coordinates and shapes, none for sizes."""
        shapes = [float(p.shape) for p in self.hypothesis.parameters]
        return np.concatenate([np.ones(len(self.nominal)), shapes])

    @property
    def penalty(self) -> float:
        """Minus the logarithm of the prior."""
        return 0.5 * float(self.prior @ self.z**2)


@dataclass
class Spent:
    """candidates : how many simulators were run through windows (window by window)."""

    candidates: int = 0


@dataclass
class Problem:
    """A recording cut into windows and the robot that it is held against.

    use : columns of the weighted channels. floor : (C,) variance of their stated noise, in units of spread^2.
    rough : whether rollouts are too rough for narrow differences; by default where a robot stands on its feet.
    begun : effects of the simulator that a search begins with, of one row; None without.
    spent : what was simulated so far, shared with problems made from this one.
    corrections : {keys of terms: (W, T, C)} what rollouts with a finer time step differ by, in units of the spread.
    whole : whether a floating base's rollouts are left uncut: see `segments`.
    sloping : the robot whose rollouts tell derivatives; None where it is `robot`.
    """

    robot: Robot
    windows: Windows
    coordinates: Coordinates
    engine: str | None = None
    threads: int = 1
    corrections: dict[frozenset[str], np.ndarray] = field(default_factory=dict)
    rough: bool | None = None
    whole: bool = False
    sloping: Robot | None = None
    begun: Terms | None = None
    spent: Spent = field(default_factory=Spent)

    def __post_init__(self):
        if self.rough is None:
            self.rough = self.stands
        self.use = np.flatnonzero(self.windows.weight > 0)
        self.floor = (self.robot.sensor_noise[self.use] / self.windows.spread[self.use]) ** 2

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
    def stands(self) -> bool:
        """Whether a floating base stands on its feet, or falls."""
        return not self.robot.planar and bool((self.robot.model.jnt_type == 0).any())  # 0: a free joint

    @property
    def segments(self) -> int:
        """Into how many parts the residual of each window is cut; 1 but for a floating base on its feet.

        A foot that slips sets it on another course, and what happens after says little of the simulator. It must not
        drown what happened before: each part counts with a variance of its own.
        """
        if self.whole or not self.stands:
            return 1
        rows = self.windows.measured.shape[1] - 1
        return max(round(rows * self.windows.period / SEGMENT), 1)

    @property
    def coarse(self) -> bool:
        """Whether the engine's integrator is so coarse that its time step misleads the search."""
        return ENGINES[self.running].coarse

    @property
    def finer(self) -> int:
        """How many times finer the time step is that tells what the model's gets wrong; 1 where none is needed."""
        return FINER_STANDING if self.stands and self.coarse else ENGINES[self.running].finer

    @cached_property
    def _finer(self) -> Robot:
        return self.robot.stepped(self.finer)

    @property
    def fine(self) -> "Problem":
        """Where rollouts are rough the same with the finer time step, without corrections; else itself."""
        if not (self.rough and self.coarse):
            return self
        sloping = self.robot.stepped(self.finer / SLOPING) if self.stands else None
        return replace(self, robot=self._finer, corrections={}, sloping=sloping)

    @property
    def sloped(self) -> "Problem":
        """The problem by whose rollouts derivatives are taken: most often itself."""
        return self if self.sloping is None else replace(self, robot=self.sloping, sloping=None)

    def states(self, points: list[Point], chosen: np.ndarray) -> np.ndarray:
        """(n, W, T+1, S) rollouts of the points through the chosen windows."""
        return self._rollouts(self.robot, points, chosen)

    def refine(self, points: list[Point], chosen: np.ndarray) -> None:
        """Find what the time step does to the rollouts of these points, and take it off all of their hypotheses.

        MuJoCo's integrator is of first order: half a time step late looks like a soft joint. That of the joint engine
        is of second order, yet delays and speed limits are found more precisely than that. Rollouts with a time step
        `finer` times finer say by how much (contacts follow no order: nothing is extrapolated). The engines of planar
        bases need none of it.
        """
        if self.finer == 1:
            return
        change = self._rollouts(self._finer, points, chosen) - self._rollouts(self.robot, points, chosen)
        scaled = change[..., 1:, self.use] / self.windows.spread[self.use]
        for point, own in zip(points, scaled, strict=True):
            known = np.zeros((len(self.windows), *own.shape[1:]))
            known[chosen] = np.clip(np.nan_to_num(own), -MOST, MOST)
            self.corrections[point.hypothesis.keys] = known

    def _correction(self, hypothesis: Hypothesis) -> np.ndarray:
        """(W, T, C) of the hypothesis, else of the one that it extends by a term."""
        for terms in (hypothesis.terms, hypothesis.terms[:-1], ()):
            known = self.corrections.get(Hypothesis(terms).keys)
            if known is not None:
                return known
        return next(iter(self.corrections.values())) * 0.0

    def _rollouts(self, robot: Robot, points: list[Point], chosen: np.ndarray) -> np.ndarray:
        self.spent.candidates += len(points)
        values = self.coordinates.values(np.array([p.nominal for p in points]))
        run = self.windows.run.take(chosen)
        return rollout(
            robot, values, run, engine=self.engine, threads=self.threads, terms=self._terms(points)
        ).states

    def residuals(self, points: list[Point], chosen: np.ndarray) -> np.ndarray:
        """(n, W, T, C) simulated - measured, in units of the channels' spread; NaN where nothing was measured.

        See `residual.scaled`. W is `segments` times the windows chosen, here and
        wherever residuals, their derivatives, samples or mean squares are spoken of; a window's are in a row.
        """
        states = self._rollouts(self.robot, points, chosen)[..., 1:, self.use]
        measured = self.windows.measured[chosen][:, 1:, self.use]
        own = [self._correction(p.hypothesis)[chosen] for p in points] if self.corrections else None
        correction = None if own is None else np.array(own)
        return self._in_segments(scaled(states, measured, self.windows.spread[self.use], correction))

    def window_errors(self, states: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(W,) weighted mean absolute error of states (W, T+1, S), in units of the channels' spread."""
        use, windows = self.use, self.windows
        measured = windows.measured[chosen][:, 1:, use]
        each = np.nanmean(np.abs(scaled(states[:, 1:, use], measured, windows.spread[use])), axis=1)
        return np.nansum(each * windows.weight[use], axis=1)

    def simulator(
        self, point: Point, chosen: np.ndarray, *, seed: int = 0
    ) -> tuple[np.ndarray, Terms | None]:
        """Parameters (P,) of the point's simulator, and its effects (of one row; None without).

        It has the motor noise that the chosen windows tell: no fit sees that; see `replay.jitter`.
        """
        values, own = self.coordinates.values(point.nominal), point.hypothesis.terms
        told = self.coordinates.effect_values(point.hypothesis, point.effect[None])
        terms = Terms(own, tuple(told)) if own else None
        where = {"engine": self.engine, "threads": self.threads, "seed": seed}
        noisy = jitter(self.robot, self.windows, values, terms, chosen, **where)
        if noisy is not values:
            self.spent.candidates += CANDIDATES
        return noisy, terms

    def _in_segments(self, rollouts: np.ndarray) -> np.ndarray:
        """(n, W, T, C) -> (n, W * segments, T / segments rounded up, C); NaN after the end."""
        if self.segments == 1:  # of most robots: nothing is copied
            return rollouts
        missing = -rollouts.shape[2] % self.segments
        padded = np.pad(rollouts, ((0, 0), (0, 0), (0, missing), (0, 0)), constant_values=np.nan)
        many, windows, rows, channels = padded.shape
        return padded.reshape(many, windows * self.segments, rows // self.segments, channels)

    def effective(self, residuals: np.ndarray) -> np.ndarray:
        """(W, C) independent samples in residuals (W, T, C); see `effective_samples`.

        Segments are too short to tell how long a residual stays alike: those of a rollout share its samples, each by
        the rows that were measured in it.
        """
        windows, rows, channels = residuals.shape
        rollouts = residuals.reshape(windows // self.segments, rows * self.segments, channels)
        samples = effective_samples(rollouts, apart=len(self.robot.actions) > 1)
        known = np.isfinite(residuals).sum(axis=1).reshape(len(rollouts), self.segments, channels)
        share = known / np.maximum(known.sum(axis=1, keepdims=True), 1)
        return (share * samples[:, None]).reshape(windows, channels)

    def _terms(self, points: list[Point]) -> Terms | None:
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


def mean_squares(residuals: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """(n, W, C) mean squared residual of every window and channel, on top of a share of the stated noise."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel that one window does not have
        return np.nanmean(residuals**2, axis=2) + FLOOR * floor


def log_likelihood(squares: np.ndarray, effective: np.ndarray) -> np.ndarray:
    """(n,) sum over windows and channels of -(n_eff / 2) log(mean square): Gaussian, with its variance unknown.

    squares : (n, W, C). effective : (W, C) independent samples in each.
    """
    return -0.5 * np.nansum(effective * np.log(squares), axis=(1, 2))

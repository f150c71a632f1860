"""The judged windows: what the simulators of a diagnosis, and baselines without a simulator, predict there.

They are read once, after the search. The rival of the causes is the better of two calibrations: with the prior of the
nameplate, and without. A tight nameplate holds a calibration back, and a gain over that would flatter the causes.
"""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.diagnose.plans.plan import State
from dynreg.evidence.data import Data
from dynreg.evidence.fit import fit
from dynreg.evidence.hypothesis import Coordinates
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.baselines import followed, held
from dynreg.replay.judged import Gain, channel_errors, gain

LOOSER = 10.0  # times the nameplate's tolerances: a prior of which a hundredth of the information is left
ITERATIONS = 6  # of the fit without the prior, which begins where that with it ended


@dataclass(frozen=True, eq=False)
class Judged:
    """The predictions on the judged windows: the test part; without one the select part.

    windows, episode : (W,) their numbers, and those of their episodes. tested : whether anything was held out.
    states : (n, W, T+1, S) of the initial, the calibrated and the unpenalised simulator, and of that after each cause.
    each : (n, W) their window errors. errors : (n, C) mean absolute errors of the weighted channels, in their units.
    held, followed : (C,) the same of the baselines; NaN where a channel has none. plain : (W,) window errors of the
    better baseline.
    """

    windows: np.ndarray
    episode: np.ndarray
    tested: bool
    states: np.ndarray
    each: np.ndarray
    errors: np.ndarray
    held: np.ndarray
    followed: np.ndarray
    plain: np.ndarray

    START, CALIBRATED, UNPENALISED, CAUSES = range(4)  # rows; from the last one on there are causes

    @property
    def causes(self) -> int:
        """How many causes there are."""
        return len(self.states) - self.CAUSES

    @property
    def last(self) -> int:
        """The row of the simulator that is left: with all causes, or without any the calibrated one."""
        return self.CAUSES + self.causes - 1 if self.causes else self.CALIBRATED

    @property
    def rival(self) -> int:
        """The row of the better calibration."""
        means = self.each[: self.CAUSES].mean(axis=1)
        return self.UNPENALISED if means[self.UNPENALISED] < means[self.CALIBRATED] else self.CALIBRATED

    def gained(self, before: int, after: int) -> Gain | None:
        """The gain of row `after` over row `before`; None where nothing was held out."""
        return gain(self.each[before], self.each[after], self.episode) if self.tested else None

    def of_cause(self, number: int) -> Gain | None:
        """The gain of a cause over the causes before it; of the first over the better calibration."""
        after = self.CAUSES + number
        return self.gained(after - 1 if number else self.rival, after)

    def clearly_worse(self, number: int) -> bool:
        """Whether a cause clearly raises the error of what it is held against: its gain lies below 0, interval and all.

        By contract a cause that changes nothing is said to in one of twenty: the interval is of 90 %.
        """
        found = self.of_cause(number)
        return found is not None and found.high is not None and found.high < 0.0

    @property
    def of_all(self) -> Gain | None:
        """The gain of all causes together over the better calibration; None without causes."""
        return self.gained(self.rival, self.last) if self.causes else None


def unpenalised(state: State, posed: Data) -> Search[Point]:
    """The calibrated simulator fitted on without the prior of its parameters, in the coordinates of the model.

    posed : the recording with its logged zeros, as the calibrated simulator is held against it.
    """
    model = state.model
    wide = loosened(model)
    values = model.coordinates.values(state.base.nominal)
    begin = Point(state.base.hypothesis, wide.coordinates.from_values(values), state.base.effect)
    (found,), _ = yield from fit(wide, [begin], replace(state.pooled, data=posed), iterations=ITERATIONS)
    values = wide.coordinates.values(found.nominal)
    return Point(found.hypothesis, model.coordinates.from_values(values), found.effect)


def loosened(model: Model) -> Model:
    """The model with tolerances so wide that its prior hardly pulls; derivatives keep their width."""
    c, accuracy = model.coordinates, model.accuracy
    wide = Coordinates(c.robot, c.known, c.centre, LOOSER * c.tolerance)
    return replace(model, coordinates=wide, accuracy=replace(accuracy, nominal=accuracy.nominal / LOOSER))


def judge(model: Model, state: State, loose: Point, posed: Data) -> Search[Judged]:
    """Simulate the judged windows once, and hold them against all that were found.

    model : as posed: a simulator is judged by its own time step, as it will be used. loose : see `unpenalised`.
    """
    parts, windows = posed.parts, posed.windows
    tested = bool(parts.test.any())
    judged = np.flatnonzero(parts.test if tested else parts.select)
    points = [model.start, state.base, loose, *stages(state)]
    states = yield from model.states(points, windows.run.take(judged))
    still, led = held(model.robot, windows)[judged], followed(model.robot, windows, parts.chosen)[judged]
    errors = channel_errors(windows, np.concatenate([states, [still, led]]), judged)
    errors[-1, np.isnan(led).all(axis=(0, 1))] = np.nan  # what follows no command has not diverged
    errors = errors[:, posed.use]
    each = np.stack([posed.window_errors(one, judged) for one in states])
    plain = [posed.window_errors(one, judged) for one in (still, np.where(np.isnan(led), still, led))]
    plain = min(plain, key=np.mean)
    return Judged(judged, windows.episode[judged], tested, states, each, errors[:-2], *errors[-2:], plain)


def stages(state: State) -> list[Point]:
    """The point after each accepted cause; the last is the extended simulator, refitted on fit and select."""
    after = [naming.chosen.point for naming in state.rounds[: state.accepted]]
    return [*after[:-1], state.current] if after else []

"""A simulator made from neighbours: a search for the region of the best, slopes simulated there, and better starts.

All judge by residuals without what errors of the measured start states explain (`replay/start_error.py`). Else noise in
a speed would be taken for a friction. Near the answer these errors are told well: windows are then begun anew without
them, and it is sharpened once more.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.neighbours.sharpen import Made, sharpen
from dynreg.neighbours.synthesise import Replays, refine, replays_of
from dynreg.replay.start_error import StartErrors, StartSlopes, believed, start_slopes
from dynreg.replay.windows import Replayer, errors


@dataclass(frozen=True)
class Spend:
    """Replays of the search for the region, of the rounds that sharpen its best, and of those with better starts."""

    search: int
    rounds: int
    again: int


@dataclass(frozen=True, eq=False)
class Replaying:
    """How unit parameters are replayed in the windows that choose.

    values_of : (n, P) parameters in their units. believed : the measured start states are. initial : (W', S) start
    states, None for those that were measured. report : called after each replay.
    """

    replayer: Replayer
    chosen: np.ndarray
    values_of: Callable[[np.ndarray], np.ndarray]
    report: Callable[[], None]
    believed: bool
    initial: np.ndarray | None = None

    def residuals(self, unit: np.ndarray) -> np.ndarray:
        """(n, W', T, S') of unit parameters (n, P)."""
        found = self.replayer.residuals(self.values_of(unit), self.chosen, self.initial)
        self.report()
        return found

    def slopes(self, unit: np.ndarray, residual: np.ndarray) -> StartSlopes:
        """Of the start states, about unit parameters (P,) with residuals (W', T, S')."""
        if self.believed:
            return believed(residual)
        return start_slopes(self.replayer, self.values_of(unit[None])[0], self.chosen, residual, self.initial)

    def moved(self, start: StartErrors, residual: np.ndarray) -> "Replaying":
        """From start states without the errors that residuals (W', T, S') tell."""
        measured = self.replayer.windows.run.initial[self.chosen]
        initial = (measured if self.initial is None else self.initial).copy()
        initial[:, start.channels] -= start.told(residual) * self.replayer.robot.sensor_noise[start.channels]
        return replace(self, initial=initial)


def of_starts(noisy: int) -> int:
    """Replays that errors of start states cost, of so many channels that state a noise.

    Their slopes before the search, after it and at the answer; there, one from better starts and one from measured.
    """
    return 3 * noisy + 2 if noisy else 0


def make(begun: Replays, residuals: np.ndarray, replaying: Replaying, spend: Spend, seed: int) -> Made:
    """The best simulator after a search from replays with residuals (n, W', T, S')."""
    first = int(begun.score.argmin())
    start = replaying.slopes(begun.unit[first], residuals[first]).errors(residuals[first])
    replays = replays_of(begun.space, begun.free, begun.to_fit, begun.unit, start.removed(residuals))
    best = replays.score.min()
    residual = residuals[int(replays.score.argmin())]

    def judged(unit: np.ndarray) -> np.ndarray:
        nonlocal best, residual
        raw = replaying.residuals(unit)
        without = start.removed(raw)
        score = errors(without).mean(axis=1)
        if score.min() < best:
            best, residual = score.min(), raw[int(score.argmin())]
        return without

    replays = refine(replays, judged, spend.search, seed)
    slopes = replaying.slopes(replays.unit[int(replays.score.argmin())], residual)
    made = sharpen(replays, residual, replaying.residuals, slopes, spend.rounds)
    if made.start is None or not len(made.start.channels):
        return made
    return _from_better_starts(made, replaying, spend.again)


def _from_better_starts(made: Made, replaying: Replaying, budget: int) -> Made:
    """The same sharpened once more, from start states without the errors that it tells."""
    moved, space = replaying.moved(made.start, made.residual), made.replays.space
    unit = made.replays.unit[[made.best]]
    raw = moved.residuals(unit)
    slopes = moved.slopes(unit[0], raw[0])
    alone = replays_of(
        space, made.replays.free, made.replays.to_fit, unit, slopes.errors(raw[0]).removed(raw)
    )
    again = sharpen(alone, raw[0], moved.residuals, slopes, budget)
    (residual,) = replaying.residuals(again.replays.unit[[again.best]])
    return replace(again, residual=residual, initial=moved.initial)

"""A simulator made from neighbours, in two steps: a search for the region of the best, and slopes simulated there.

Both judge by residuals without what errors of the measured start states explain (`replay/start_error.py`). Else noise
in a speed would be taken for a friction.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.neighbours.sharpen import Made, sharpen
from dynreg.neighbours.synthesise import Replays, Residuals, refine, replays_of
from dynreg.replay.start_error import StartSlopes

SlopesAt = Callable[[np.ndarray, np.ndarray], StartSlopes]  # of unit parameters (P,), residuals (W', T, S')


@dataclass(frozen=True)
class Spend:
    """Replays of the search for the region, and of the rounds that sharpen its best."""

    search: int
    rounds: int


def of_starts(noisy: int) -> int:
    """Replays that tell errors of start states, of so many channels that state a noise: before and after the search."""
    return 2 * noisy


def make(
    begun: Replays, residuals: np.ndarray, replay: Residuals, slopes_at: SlopesAt, spend: Spend, seed: int
) -> Made:
    """The best simulator after a search from replays with residuals (n, W', T, S')."""
    first = int(begun.score.argmin())
    start = slopes_at(begun.unit[first], residuals[first]).errors(residuals[first])
    seen = [residuals]

    def judged(unit: np.ndarray) -> np.ndarray:
        seen.append(replay(unit))
        return start.removed(seen[-1])

    replays = replays_of(begun.space, begun.free, begun.to_fit, begun.unit, start.removed(residuals))
    replays = refine(replays, judged, spend.search, seed)
    best = int(replays.score.argmin())
    residual = next(row for number, row in enumerate(row for rows in seen for row in rows) if number == best)
    slopes = slopes_at(replays.unit[best], residual)
    return sharpen(replays, residual, replay, slopes, spend.rounds)

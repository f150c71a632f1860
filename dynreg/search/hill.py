"""Hill climbing with restarts, by ask and tell, in the unit cube: the search of the gait paper."""

import numpy as np

from dynreg.search.start import Start
from dynreg.search.turns import Turns


class HillClimber(Turns):
    """Climbers side by side, each from a random start: a Gaussian step in every dimension, kept where it is better.

    A climber that has found nothing yet (no loss below 0) is put to another start: from a plain there is no way up.

    Parameters
    ----------
    dimensions : P. restarts : climbers. step : 1 sigma, as a share of the range. rng : of all draws.
    periodic : (P,) dimensions that run round; steps across the other bounds end there. start : (P,) the first
    start of the first climber, random without it.
    """

    def __init__(
        self,
        dimensions: int,
        *,
        rng: np.random.Generator,
        restarts: int = 5,
        step: float = 0.1,
        periodic: np.ndarray | None = None,
        start: np.ndarray | None = None,
    ):
        self._rng, self._step = rng, step
        self._periodic = np.zeros(dimensions, dtype=bool) if periodic is None else periodic
        self._at = np.full((restarts, dimensions), np.nan)
        self._losses = np.full(restarts, np.inf)
        self._first = start

    def candidates(self) -> np.ndarray:
        """(restarts, P) one of every climber."""
        start = self._rng.uniform(size=self._at.shape)
        if self._first is not None:
            start[0], self._first = self._first, None
        near = self._at + self._step * self._rng.standard_normal(self._at.shape)
        asked = np.where((self._losses < 0.0)[:, None], near, start)
        return np.where(self._periodic, np.mod(asked, 1.0), np.clip(asked, 0.0, 1.0))

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """Climbers step to what is better."""
        better = losses < self._losses
        self._at = np.where(better[:, None], asked, self._at)
        self._losses = np.where(better, losses, self._losses)


def begin(start: Start) -> HillClimber:
    """As many climbers as a batch has candidates, the first at the point that is known."""
    return HillClimber(
        start.dimensions, rng=start.rng, restarts=start.batch, periodic=start.periodic, start=start.point
    )

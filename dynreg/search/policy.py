"""The policy gradient of Kohl and Stone by ask and tell, in the unit cube: paper B's search on the robot itself."""

import numpy as np

from dynreg.errors import UsageError
from dynreg.search.start import Start
from dynreg.search.turns import Turns

CHANGE = 0.02  # of the range, by which a gene is changed
RATE = 2.0 * CHANGE  # length of a step


class PolicyGradient(Turns):
    """A point moves down an estimated gradient by steps of one length (Kohl and Stone, ICRA 2004, Figure 2).

    In each candidate every gene of the point is lower by `change`, the same, or higher, at random. For each gene this
    makes three groups of candidates. Where the mean loss is the lowest in the group that is the same, the gene stays.
    Else its part of the step is the mean loss of the lower group less that of the higher one.

    A gene of which a group of changed ones is empty stays, too. Where the group that is the same is empty, the two
    others decide.

    Parameters
    ----------
    start : (P,) where the point begins. rng : of all draws. batch : candidates of one ask. change : of the range.
    rate : length of a step in the unit cube. periodic : (P,) dimensions that run round; the others end at the bounds.
    Raises UsageError for sizes below which nothing moves.
    """

    def __init__(
        self,
        start: np.ndarray,
        *,
        rng: np.random.Generator,
        batch: int = 15,
        change: float = CHANGE,
        rate: float = RATE,
        periodic: np.ndarray | None = None,
    ):
        if batch < 2 or change <= 0.0 or rate <= 0.0:
            raise UsageError(
                f"batch {batch}, change {change}, rate {rate}",
                expected="a batch of 2 or more, a change and a rate above 0",
                do="correct them",
            )
        self._rng, self._change, self._rate = rng, change, rate
        self._round = np.zeros(len(start), dtype=bool) if periodic is None else periodic
        self._shape = (batch, len(start))
        self.middle = self._inside(start)

    def candidates(self) -> np.ndarray:
        """(batch, P) about the point."""
        self._signs = self._rng.integers(-1, 2, size=self._shape)
        return self._inside(self.middle + self._change * self._signs)

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """The point moves; a loss that is no number counts like the worst of the others."""
        told = np.isfinite(losses)
        if not told.any():
            return
        worst = losses[told].max()
        lower, same, higher = (self._means(np.where(told, losses, worst), sign) for sign in (-1, 0, 1))
        slope = lower - higher  # NaN where one of them is empty
        # a comparison with NaN is false: an empty group in the middle keeps nothing where it is
        stays = np.isnan(slope) | ((same <= lower) & (same <= higher))
        slope = np.where(stays, 0.0, slope)
        length = np.linalg.norm(slope)
        if length > 0.0:
            self.middle = self._inside(self.middle + self._rate * slope / length)

    def _means(self, losses: np.ndarray, sign: int) -> np.ndarray:
        """(P,) mean loss of the candidates in which a gene was changed by `sign`; NaN where there are none."""
        those = self._signs == sign
        count = those.sum(axis=0)
        return np.where(count > 0, losses @ those / np.maximum(count, 1), np.nan)

    def _inside(self, x: np.ndarray) -> np.ndarray:
        return np.where(self._round, np.mod(x, 1.0), np.clip(x, 0.0, 1.0))


def begin(start: Start) -> PolicyGradient:
    """From the point that is known, else the middle of the cube."""
    point = np.full(start.dimensions, 0.5) if start.point is None else start.point
    return PolicyGradient(point, rng=start.rng, batch=start.batch, periodic=start.periodic)

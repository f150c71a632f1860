"""Random search by ask and tell, in the unit cube: what every other search must beat at an equal budget."""

import numpy as np

from dynreg.search.start import Start
from dynreg.search.turns import may_ask, may_tell


class AtRandom:
    """Uniform draws.

    dimensions : P. batch : candidates of one ask. rng : of all draws.
    """

    def __init__(self, dimensions: int, *, rng: np.random.Generator, batch: int = 10):
        self._rng, self._shape = rng, (batch, dimensions)
        self._asked: np.ndarray | None = None

    def ask(self) -> np.ndarray:
        """(batch, P) candidates to evaluate; raises UsageError when the last ones were not told yet."""
        may_ask(self._asked)
        self._asked = self._rng.uniform(size=self._shape)
        return self._asked.copy()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (batch,) of the candidates asked for, which change nothing; raises UsageError without an ask."""
        may_tell(self._asked, losses)
        self._asked = None

    @property
    def middle(self) -> None:
        """None: it bets on the best that it saw."""

    @property
    def stopped(self) -> bool:
        """Never."""
        return False


def begin(start: Start) -> AtRandom:
    """Anywhere, whatever is known."""
    return AtRandom(start.dimensions, rng=start.rng, batch=start.batch)

"""Random search by ask and tell, in the unit cube: what every other search must beat at an equal budget."""

import numpy as np

from dynreg.search.start import Start
from dynreg.search.turns import Turns


class AtRandom(Turns):
    """Uniform draws.

    dimensions : P. batch : candidates of one ask. rng : of all draws.
    """

    def __init__(self, dimensions: int, *, rng: np.random.Generator, batch: int = 10):
        self._rng, self._shape = rng, (batch, dimensions)

    def candidates(self) -> np.ndarray:
        """(batch, P) anywhere."""
        return self._rng.uniform(size=self._shape)

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """Nothing."""


def begin(start: Start) -> AtRandom:
    """Anywhere, whatever is known."""
    return AtRandom(start.dimensions, rng=start.rng, batch=start.batch)

"""Random search by ask and tell, in the unit cube: what every other search must beat at an equal budget."""

import numpy as np


class AtRandom:
    """Uniform draws.

    dimensions : P. batch : candidates of one ask. rng : of all draws.
    """

    def __init__(self, dimensions: int, *, rng: np.random.Generator, batch: int = 10):
        self._rng, self._shape = rng, (batch, dimensions)

    def ask(self) -> np.ndarray:
        """(batch, P) candidates to evaluate."""
        return self._rng.uniform(size=self._shape)

    def tell(self, losses: np.ndarray) -> None:
        """Losses of the candidates asked for: they change nothing."""

    @property
    def middle(self) -> None:
        """None: it bets on the best that it saw."""

    @property
    def stopped(self) -> bool:
        """Never."""
        return False

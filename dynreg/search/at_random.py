"""Random search by ask and tell, in the unit cube: what every other search must beat at an equal budget."""

import numpy as np


class AtRandom:
    """Uniform draws.

    dimensions : P. batch : candidates of one ask. rng : of all draws. start : (P,) the first candidate.
    """

    def __init__(
        self,
        dimensions: int,
        *,
        rng: np.random.Generator,
        batch: int = 10,
        start: np.ndarray | None = None,
    ):
        self._rng, self._shape, self._first = rng, (batch, dimensions), start

    def ask(self) -> np.ndarray:
        """(batch, P) candidates to evaluate."""
        asked = self._rng.uniform(size=self._shape)
        if self._first is not None:
            asked[0], self._first = self._first, None
        return asked

    def tell(self, losses: np.ndarray) -> None:
        """Losses of the candidates asked for: they change nothing."""

    @property
    def stopped(self) -> bool:
        """Never."""
        return False

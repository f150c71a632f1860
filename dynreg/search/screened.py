"""CMA-ES that looks around before it sets out: for functions of which most of the range is worth nothing."""

from collections.abc import Callable

import numpy as np

from dynreg.search.cmaes import CmaEs

AROUND = 0.25  # of the range, 1 sigma, of the candidates about the start


class ScreenedCmaEs:
    """Draws `screen` candidates, half of them about `start`, half anywhere; then CMA-ES begins at the best.

    Parameters
    ----------
    start : (P,) the first candidate. screen : how many are drawn before. batch : of them in one ask.
    sigma : first step size of CMA-ES. rng : of all draws.
    """

    def __init__(
        self,
        start: np.ndarray,
        *,
        rng: np.random.Generator,
        screen: int,
        batch: int = 10,
        sigma: float = 0.12,
    ):
        draws = rng.uniform(size=(max(screen // batch, 1) * batch, len(start)))
        about = np.clip(start + AROUND * rng.standard_normal(draws.shape), 0.0, 1.0)
        draws[::2] = about[::2]
        draws[0] = start
        self._batches = list(draws.reshape(-1, batch, len(start)))
        self._best: tuple[float, np.ndarray] = (np.inf, start)
        self._asked: np.ndarray | None = None
        self._search: CmaEs | None = None
        self._begin: Callable[[np.ndarray], CmaEs] = lambda best: CmaEs(best, sigma=sigma, rng=rng)

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate."""
        if self._batches:
            self._asked = self._batches.pop(0)
            return self._asked.copy()
        if self._search is None:
            self._search = self._begin(self._best[1])
        return self._search.ask()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better."""
        if self._search is not None:
            self._search.tell(losses)
            return
        at = int(np.argmin(losses))
        if losses[at] < self._best[0]:
            self._best = (float(losses[at]), self._asked[at])

    @property
    def stopped(self) -> bool:
        """Whether CMA-ES has converged."""
        return self._search is not None and self._search.stopped

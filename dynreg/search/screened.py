"""A search that looks around before it sets out: for functions of which most of the range is worth nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynreg.search.drive import Search
from dynreg.search.start import Start
from dynreg.search.table import Kind
from dynreg.search.turns import may_ask, may_tell

AROUND = 0.25  # of the range, 1 sigma, of draws about a start


def around(
    starts: np.ndarray, many: int, rng: np.random.Generator, periodic: np.ndarray | None = None
) -> np.ndarray:
    """(many, P) draws in the unit cube: half of them about starts (n, P) in turn, half anywhere; all where n is 0.

    periodic : (P,) dimensions that run round.
    """
    draws = rng.uniform(size=(many, starts.shape[1]))
    if len(starts):
        about = draws[::2]
        about[:] = starts[np.arange(len(about)) % len(starts)] + AROUND * rng.standard_normal(about.shape)
        round_ = np.zeros(about.shape[1], dtype=bool) if periodic is None else periodic
        about[:] = np.where(round_, np.mod(about, 1.0), np.clip(about, 0.0, 1.0))
    return draws


class Screened:
    """Tries `candidates` (n, P), `batch` at a time; then the search that `begin` makes sets out from the best.

    Without candidates (0, P) the search begins in the middle of the unit cube.
    """

    def __init__(self, candidates: np.ndarray, begin: Callable[[np.ndarray], Search], *, batch: int = 10):
        many = len(candidates)
        self._batches = [candidates[at : at + batch] for at in range(0, many, batch)]
        self._best: tuple[float, np.ndarray] = (np.inf, np.full(candidates.shape[1], 0.5))
        self._begin = begin
        self._asked: np.ndarray | None = None
        self._search: Search | None = None

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate; raises UsageError when the last ones were not told yet."""
        if self._batches:
            may_ask(self._asked)
            self._asked = self._batches.pop(0)
            return self._asked.copy()
        if self._search is None:
            may_ask(self._asked)
            self._search = self._begin(self._best[1])
        return self._search.ask()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better; raises UsageError without an ask."""
        if self._search is not None:
            self._search.tell(losses)
            return
        may_tell(self._asked, losses)
        at = int(np.argmin(losses))
        if losses[at] < self._best[0]:
            self._best = (float(losses[at]), self._asked[at])
        self._asked = None

    @property
    def middle(self) -> np.ndarray | None:
        """(P,) what the search that set out bets on, if it does."""
        return None if self._search is None else self._search.middle

    @property
    def stopped(self) -> bool:
        """Whether the search that set out is over."""
        return self._search is not None and self._search.stopped


def after(candidates: np.ndarray, kind: Kind, start: Start) -> Screened:
    """A search that tries candidates (n, P) first and sets out from the best of them; from `start` where n is 0."""

    def set_out(best: np.ndarray) -> Search:
        return kind.begin(replace(start, point=best) if len(candidates) else start)

    return Screened(candidates, set_out, batch=start.batch)

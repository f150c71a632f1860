"""A search that looks around before it sets out: for functions of which most of the range is worth nothing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynreg.search.drive import Search
from dynreg.search.race import Race
from dynreg.search.start import Start
from dynreg.search.table import Kind
from dynreg.search.turns import may_ask, may_tell

AROUND = 0.25  # of the range, 1 sigma, of draws about a start
APART = 0.15  # of the range in some dimension, from which on two starts are different ones


def around(
    starts: np.ndarray, many: int, rng: np.random.Generator, periodic: np.ndarray | None = None
) -> np.ndarray:
    """(many, P) draws in the unit cube about starts (n, P) in turn.

    periodic : (P,) dimensions that run round.
    """
    about = starts[np.arange(many) % len(starts)]
    about = about + AROUND * rng.standard_normal(about.shape)
    round_ = np.zeros(starts.shape[1], dtype=bool) if periodic is None else periodic
    return np.where(round_, np.mod(about, 1.0), np.clip(about, 0.0, 1.0))


Stage = Callable[[np.ndarray], np.ndarray]  # (n, P) tried so far, the best first -> (m, P) to try next


class Screened:
    """Tries what each of its stages names, `batch` at a time; then the search that `begin` makes sets out.

    stages : each names its candidates by those that were tried before it. begin : makes the search of all that were
    tried, (n, P), the best first; of the middle of the unit cube where nothing was. dimensions : P.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        begin: Callable[[np.ndarray], Search],
        *,
        dimensions: int,
        batch: int = 10,
    ):
        self._stages, self._begin, self._batch = list(stages), begin, batch
        self._batches: list[np.ndarray] = []
        self._tried = np.empty((0, dimensions))
        self._losses = np.empty(0)
        self._asked: np.ndarray | None = None
        self._search: Search | None = None

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate; raises UsageError when the last ones were not told yet."""
        if self._search is None:
            may_ask(self._asked)
            while self._stages and not self._batches:
                candidates = self._stages.pop(0)(self._ordered())
                self._batches = [
                    candidates[i : i + self._batch] for i in range(0, len(candidates), self._batch)
                ]
            if self._batches:
                self._asked = self._batches.pop(0)
                return self._asked.copy()
            middle = np.full((1, self._tried.shape[1]), 0.5)
            self._search = self._begin(self._ordered() if len(self._tried) else middle)
        return self._search.ask()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better; raises UsageError without an ask."""
        if self._search is not None:
            self._search.tell(losses)
            return
        may_tell(self._asked, losses)
        self._tried = np.concatenate([self._tried, self._asked])
        self._losses = np.concatenate([self._losses, losses])
        self._asked = None

    def _ordered(self) -> np.ndarray:
        return self._tried[np.argsort(self._losses, kind="stable")]

    @property
    def middle(self) -> np.ndarray | None:
        """(P,) what the search that set out bets on, if it does."""
        return None if self._search is None else self._search.middle

    @property
    def stopped(self) -> bool:
        """Whether the search that set out is over."""
        return self._search is not None and self._search.stopped


def different(candidates: np.ndarray, count: int, periodic: np.ndarray | None = None) -> np.ndarray:
    """(n, P) the first of the candidates, at most `count`, each `APART` from those before it.

    periodic : (P,) dimensions that run round.
    """
    kept: list[np.ndarray] = []
    for one in candidates:
        gaps = [np.abs(one - other) for other in kept]
        if periodic is not None:
            gaps = [np.where(periodic, np.minimum(gap, 1.0 - gap), gap) for gap in gaps]
        if all(gap.max() > APART for gap in gaps):
            kept.append(one)
        if len(kept) == count:
            break
    return np.array(kept)


def after(
    candidates: np.ndarray,
    kind: Kind,
    start: Start,
    *,
    then: Sequence[Stage] = (),
    runs: int = 1,
    laps: int = 0,
) -> Screened:
    """A search that tries candidates (n, P) first and sets out from the best of them; from `start` where n is 0.

    then : further stages; see `Screened`. runs : searches that set out from different ones of the best, `laps` batches
    each, before only one goes on.
    """

    def set_out(tried: np.ndarray) -> Search:
        if not (len(candidates) or then):
            return kind.begin(start)
        begun = [kind.begin(replace(start, point=p)) for p in different(tried, runs, start.periodic)]
        return begun[0] if len(begun) == 1 else Race(begun, laps)

    return Screened([lambda _: candidates, *then], set_out, dimensions=start.dimensions, batch=start.batch)

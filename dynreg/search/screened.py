"""A search that looks around before it sets out: for functions of which most of the range is worth nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynreg.search.drive import Search
from dynreg.search.race import Race
from dynreg.search.start import Start
from dynreg.search.table import Kind
from dynreg.search.turns import may_ask, may_tell

# Our choices, of the range:
AROUND = 0.25  # 1 sigma of draws about a start
APART = 0.15  # in some dimension, from which on two starts are different ones


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


class Screened:
    """Tries `candidates` (n, P), `batch` at a time; then the search that `begin` makes sets out.

    begin : makes it of the candidates (n, P) that were tried, the best first. Without any it gets the middle of the
    unit cube.
    """

    def __init__(self, candidates: np.ndarray, begin: Callable[[np.ndarray], Search], *, batch: int = 10):
        many = len(candidates)
        self._batches = [candidates[at : at + batch] for at in range(0, many, batch)]
        self._tried: list[np.ndarray] = []
        self._losses: list[np.ndarray] = []
        self._middle = np.full((1, candidates.shape[1]), 0.5)
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
            self._search = self._begin(self._ordered())
        return self._search.ask()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better; raises UsageError without an ask."""
        if self._search is not None:
            self._search.tell(losses)
            return
        may_tell(self._asked, losses)
        self._tried.append(self._asked)
        self._losses.append(np.array(losses, dtype=float))
        self._asked = None

    def _ordered(self) -> np.ndarray:
        if not self._tried:
            return self._middle
        return np.concatenate(self._tried)[np.argsort(np.concatenate(self._losses), kind="stable")]

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


def after(candidates: np.ndarray, kind: Kind, start: Start, *, runs: int = 1, laps: int = 0) -> Screened:
    """A search that tries candidates (n, P) first and sets out from the best of them; from `start` where n is 0.

    runs : searches that set out from different ones of the best, `laps` batches each, before only one goes on.
    """

    def set_out(tried: np.ndarray) -> Search:
        if not len(candidates):
            return kind.begin(start)
        begun = [kind.begin(replace(start, point=p)) for p in different(tried, runs, start.periodic)]
        return begun[0] if len(begun) == 1 else Race(begun, laps)

    return Screened(candidates, set_out, batch=start.batch)

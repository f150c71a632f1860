"""Drives any ask-and-tell search within a budget; what was asked and found is kept, so that it can go on later."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynreg.search.journal import Journal


class Search(Protocol):
    """What proposes candidates in the unit cube and learns from their losses."""

    stopped: bool
    middle: np.ndarray | None  # (P,) its bet where losses are noisy; None where it has none

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate."""

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better."""


@dataclass(frozen=True)
class Limits:
    """When a search ends.

    evaluations : candidates at most. cut : of a batch that would not fit, those are tried that do, and the search is
    not told of them, for it learns from whole batches; else it is not begun (the first one always is). patience :
    candidates without a better one after which to give up, None for never.
    """

    evaluations: int
    patience: int | None = None
    cut: bool = False


@dataclass(frozen=True, eq=False)
class Found:
    """The best candidate (P,), its grades (k,) and value, and (evaluations, its value) whenever a better one came.

    ended : "budget", "patience" or "converged". resumed : evaluations taken from the journal.
    """

    best: np.ndarray
    grades: np.ndarray
    value: float
    history: tuple[tuple[int, float], ...]
    evaluations: int
    resumed: int
    ended: str


def drive(
    search: Search,
    grades: Callable[[np.ndarray], np.ndarray],
    judge: Callable[[np.ndarray], tuple[np.ndarray, ...]],
    limits: Limits,
    *,
    journal: Journal | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Found:
    """Look for the best candidate, which is the one with the highest value.

    grades : (n, k) of candidates (n, P). judge : values (n,) of grades (n, k), and the losses (n,) to tell; where the
    values alone do not say which is better, also ranks (n, m): the first counts most, higher is better. Of equals the
    best is the one with the lowest loss.
    journal : what an interrupted run of the same search left; its candidates are not evaluated again.
    """
    best, top, spent, resumed, last, history = None, None, 0, 0, 0, []
    while True:
        asked = search.ask()
        room = limits.evaluations - spent
        cut = limits.cut and room < len(asked)
        if best is not None and room < len(asked) and not cut:
            return Found(*best, tuple(history), spent, resumed, "budget")
        asked = asked[:room] if cut else asked
        known = journal.next(asked) if journal else None
        found = grades(asked) if known is None else known
        if known is not None:
            resumed += len(asked)
        elif journal:
            journal.add(asked, found)
        values, losses, *told = judge(found)
        ranks = told[0] if told else values[:, None]
        if not cut:
            search.tell(losses)
        ranks = np.where(np.isnan(ranks), -np.inf, ranks)  # what is no number is the worst
        losses = np.where(np.isnan(losses), np.inf, losses)
        at = int(np.lexsort((losses, *-ranks.T[::-1]))[0])  # of equals the one that the search likes best
        rank, value = (*ranks[at].tolist(), -float(losses[at])), float(values[at])
        if best is None or rank > top:
            if best is None or rank[:-1] > top[:-1]:
                last = spent + at + 1
                history.append((last, value))
            best, top = (asked[at], found[at], value), rank
        spent += len(asked)
        if progress:
            progress(spent, limits.evaluations)
        if limits.patience is not None and spent - last >= limits.patience:
            return Found(*best, tuple(history), spent, resumed, "patience")
        if spent >= limits.evaluations or search.stopped:
            ended = "budget" if spent >= limits.evaluations else "converged"
            return Found(*best, tuple(history), spent, resumed, ended)

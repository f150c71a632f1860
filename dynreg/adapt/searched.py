"""Searched: unit parameters with a low loss, by any search; what it begins with is tried first, so none ends worse."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.search.drive import Limits, Search, drive
from dynreg.search.journal import Journal
from dynreg.search.screened import Screened


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search found: unit parameters (P,), and the losses that it began and ended with.

    history : (candidates, lowest loss) whenever it fell, and at the end; no number of candidates twice. ended : see
    `drive.Found`. resumed : candidates taken from the journal.
    """

    unit: np.ndarray
    first: float
    last: float
    history: tuple[tuple[int, float], ...]
    evaluations: int
    ended: str
    resumed: int = 0


def searched(
    loss: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    free: np.ndarray,
    begin: Callable[[np.ndarray], Search],
    limits: Limits,
    *,
    most: float,
    journal: Journal | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Searched:
    """The unit parameters with the lowest loss that a search finds, never worse than `start` (P,).

    loss : (n,) of unit parameters (n, P). free : numbers (F,) of those that are searched. begin : makes the search, in
    the unit cube of these, of where it sets out (F,). most : the loss of a simulation that diverged.
    """

    def whole(some: np.ndarray) -> np.ndarray:
        unit = np.tile(start, (len(some), 1))
        unit[:, free] = some
        return unit

    found = drive(
        Screened(start[None, free], lambda tried: begin(tried[0])),
        lambda some: loss(whole(some))[:, None],
        # climbers take losses below 0 for ground, and a diverged simulation's is 0
        lambda grades: (-grades[:, 0], grades[:, 0] - most),
        limits if len(free) else Limits(1),
        journal=journal,
        progress=progress,
    )
    history = {spent: -value for spent, value in (*found.history, (found.evaluations, found.value))}
    lowest = tuple(history.values())
    return Searched(
        unit=whole(found.best[None])[0],
        first=lowest[0],
        last=lowest[-1],
        history=tuple(history.items()),
        evaluations=found.evaluations,
        ended=found.ended if len(free) else "nothing to fit",
        resumed=found.resumed,
    )

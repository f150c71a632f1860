"""Searches side by side, of which only the best goes on: for functions with many local optima."""

from collections.abc import Sequence

import numpy as np

from dynreg.search.drive import Search

LATELY = 3  # batches by whose best losses runs are compared: with new noise in every batch one may be lucky


class Race:
    """Each of `runs` is asked in turn for `laps` batches; after these only the best goes on.

    The best is the run with the lowest mean over its last batches of the lowest loss in each. laps : at least 1.
    """

    def __init__(self, runs: Sequence[Search], laps: int):
        if laps < 1:
            raise ValueError(f"laps = {laps}: a run that was never asked cannot be compared")
        self._runs, self._laps = list(runs), laps
        self._found: list[list[float]] = [[] for _ in runs]
        self._turn = 0

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate, of the run whose turn it is; raises UsageError when the last were not told."""
        return self._runs[self._turn].ask()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better; raises UsageError without an ask."""
        self._runs[self._turn].tell(losses)
        self._found[self._turn].append(float(np.min(losses)))
        if len(self._runs) == 1:
            return
        going = [
            i for i, run in enumerate(self._runs) if len(self._found[i]) < self._laps and not run.stopped
        ]
        if going:
            later = [i for i in going if i > self._turn]
            self._turn = (later or going)[0]
            return
        best = min(range(len(self._runs)), key=lambda i: float(np.mean(self._found[i][-LATELY:])))
        self._runs, self._found, self._turn = [self._runs[best]], [self._found[best]], 0

    @property
    def middle(self) -> np.ndarray | None:
        """(P,) what the run that goes on bets on, if it does; None while several run."""
        return self._runs[0].middle if len(self._runs) == 1 else None

    @property
    def stopped(self) -> bool:
        """Whether the run that goes on is over."""
        return len(self._runs) == 1 and self._runs[0].stopped

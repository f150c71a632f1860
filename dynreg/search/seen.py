"""A search whose candidates are remembered, so that the good ones among all can be looked at again."""

import numpy as np

from dynreg.search.drive import Search


class Seen:
    """A search whose candidates are remembered with their losses. asks : how often it was asked."""

    def __init__(self, search: Search):
        self._search = search
        self._asked: list[np.ndarray] = []
        self._losses: list[np.ndarray] = []

    @property
    def stopped(self) -> bool:
        return self._search.stopped

    @property
    def asks(self) -> int:
        return len(self._asked)

    @property
    def middle(self) -> np.ndarray | None:
        return self._search.middle

    def ask(self) -> np.ndarray:
        self._asked.append(self._search.ask().copy())
        return self._asked[-1].copy()

    def tell(self, losses: np.ndarray) -> None:
        self._losses.append(losses)
        self._search.tell(losses)

    def rounds(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Candidates (n, P) and losses (n,) of every ask that was told, in turn."""
        return [*zip(self._asked, self._losses, strict=False)]

    def best(self, count: int) -> np.ndarray:
        """(n, P) at most `count` candidates, no two of them the same: what the search bets on, then the best first."""
        losses = np.concatenate(self._losses)
        order = np.argsort(losses, kind="stable")
        candidates = np.concatenate(self._asked[: len(self._losses)])[order]
        if self.middle is not None:
            candidates = np.concatenate([self.middle[None], candidates])
        _, first = np.unique(candidates, axis=0, return_index=True)
        return candidates[np.sort(first)[:count]]

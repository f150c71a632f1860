"""Ask and tell take turns: what every search that learns from losses has in common."""

from abc import ABC, abstractmethod
from collections.abc import Sized

import numpy as np

from dynreg.errors import UsageError


def may_ask(asked: Sized | None) -> None:
    """UsageError where the candidates asked for last were not told yet; `asked` is None once they were."""
    if asked is not None:
        raise UsageError("ask after ask", expected="tell between two asks", do="tell the losses first")


def may_tell(asked: Sized | None, losses: Sized) -> None:
    """UsageError where nothing was asked, or where there is not one loss for each candidate."""
    if asked is None or len(losses) != len(asked):
        count = 0 if asked is None else len(asked)
        raise UsageError(f"{len(losses)} losses", expected=f"{count}, one for each asked", do="ask first")


class Turns(ABC):
    """A search in the unit cube: it says which candidates come next, and what it learns of their losses.

    middle : (P,) its bet where losses are noisy; None where it bets on the best that it saw. stopped : whether it has
    ended by itself, which most never do.
    """

    middle: np.ndarray | None = None
    stopped: bool = False
    _asked: np.ndarray | None = None

    def ask(self) -> np.ndarray:
        """(n, P) candidates to evaluate; raises UsageError when the last ones were not told yet."""
        may_ask(self._asked)
        self._asked = self.candidates()
        return self._asked.copy()

    def tell(self, losses: np.ndarray) -> None:
        """Losses (n,) of the candidates asked for, lower is better; raises UsageError without an ask."""
        may_tell(self._asked, losses)
        self.learn(self._asked, losses)
        self._asked = None

    @abstractmethod
    def candidates(self) -> np.ndarray:
        """(n, P) to evaluate next."""

    @abstractmethod
    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """What losses (n,) of the candidates (n, P) change."""


def ranked(losses: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(n,) numbers from the best to the worst, NaN last, and the place of each; ties fall at random.

    By their order instead, tournaments on flat ground would breed the first few alone.
    """
    order = np.lexsort((rng.random(len(losses)), losses))
    places = np.empty(len(losses), dtype=int)
    places[order] = np.arange(len(losses))
    return order, places

"""Which candidates of a generation become parents: parts of genetic algorithms."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynreg.errors import UsageError


class Selection(Protocol):
    """How parents are chosen."""

    def parents(self, losses: np.ndarray, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n,) numbers of the parents of as many children, by the losses (n,) and places (n,) of a generation."""


@dataclass(frozen=True)
class Tournament:
    """So many are drawn with replacement, and the best of them becomes a parent."""

    size: int = 6

    def __post_init__(self) -> None:
        if self.size < 1:
            raise UsageError(
                f"tournament {self.size}", expected="at least one that takes part", do="give more"
            )

    def parents(self, losses: np.ndarray, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n,) winners of n tournaments."""
        drawn = rng.integers(len(losses), size=(len(losses), self.size))
        return drawn[np.arange(len(losses)), places[drawn].argmin(axis=1)]


@dataclass(frozen=True)
class Roulette:
    """Everyone becomes a parent in proportion to its fitness, which is scaled linearly (Goldberg 1989, chapter 3).

    best : children that the best expects, as a multiple of the mean.
    """

    best: float = 2.0

    def __post_init__(self) -> None:
        if self.best <= 1.0:
            raise UsageError(f"best = {self.best}", expected="a multiple of the mean above 1", do="give one")

    def parents(self, losses: np.ndarray, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n,) drawn with replacement, each by `chances`."""
        return rng.choice(len(losses), size=len(losses), p=self.chances(losses))

    def chances(self, losses: np.ndarray) -> np.ndarray:
        """(n,) that sum up to 1, of losses (n,).

        f' = a f + b has the mean of f, and `best` times this mean for the best. Where that puts the worst below 0, it
        puts it at 0 instead. Only differences of f count then, so f = -loss serves, whatever its sign. Here the mean
        of f' is 1. A loss that is no number has no chance, unless none is one: then all have the same.
        """
        told = np.isfinite(losses)
        if not told.any():
            return np.full(len(losses), 1.0 / len(losses))
        above = np.where(told, losses[told].mean() - losses, 0.0)
        scale = max(above.max() / (self.best - 1.0), -above.min())
        # the mean of equal losses may be a rounding off them
        expected = np.where(told, 1.0 + above / scale if above.max() > 0.0 else 1.0, 0.0)
        return expected / expected.sum()

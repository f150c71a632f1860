"""A real-coded genetic algorithm by ask and tell, in the unit cube: the search of the paper on wheeled robots.

Pretorius et al.: parents are the best of tournaments, 80 % of the pairs are crossed by simulated binary crossover (Deb
and Agrawal, Complex Systems 9, 1995), and genes are moved at random by mutation. What it leaves open is ours: `eta`,
the width of a mutation, and how a gene beyond its range ends at the bound.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.errors import UsageError
from dynreg.search.selection import Tournament
from dynreg.search.start import Start
from dynreg.search.turns import Turns, ranked


@dataclass(frozen=True, eq=False)
class Rules:
    """How one generation is bred from another; as published, but for what is ours.

    population : candidates of a generation, an even number. tournament : drawn with replacement, the best of them
    becomes a parent. crossover : share of the pairs that are crossed. eta : how near children of a crossing stay to
    their parents, from 0. mutation : chance of every gene to be moved. width : (P,) or one: by up to so much of the
    range; 1 draws it anew (what is chosen, not tuned). elite : the best so many go on as they are, no children.
    Raises UsageError for sizes that do not fit each other.
    """

    population: int = 200
    tournament: int = 40
    crossover: float = 0.8
    eta: float = 5.0
    mutation: float = 0.05
    width: float | np.ndarray = 0.1
    elite: int = 0

    def __post_init__(self) -> None:
        even = self.population >= 2 and not self.population % 2
        if not even or self.tournament < 1 or not 0 <= self.elite < self.population:
            raise UsageError(
                f"population {self.population}, tournament {self.tournament}, elite {self.elite}",
                expected="an even population, a tournament of at least 1, an elite smaller than the population",
                do="correct them",
            )


PUBLISHED = Rules()


class Genetic(Turns):
    """Generations of candidates, each bred from the one before by `rules`; the first is drawn evenly.

    dimensions : P. rng : of all draws. start : (P,) the first candidate, random without it.
    """

    def __init__(
        self,
        dimensions: int,
        *,
        rng: np.random.Generator,
        rules: Rules = PUBLISHED,
        start: np.ndarray | None = None,
    ):
        self._rng, self._rules = rng, rules
        self._width = np.broadcast_to(rules.width, (dimensions,))
        self._next = rng.uniform(size=(rules.population, dimensions))
        if start is not None:
            self._next[0] = start

    def candidates(self) -> np.ndarray:
        """(population, P) the generation."""
        return self._next

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """The next generation is bred from the winners of as many tournaments; a loss that is NaN is the worst."""
        elite = self._rules.elite
        order, places = ranked(losses, self._rng)
        winners = Tournament(self._rules.tournament).parents(losses, places, self._rng)
        self._next = self._mutated(self._crossed(asked[winners]))
        self._next[:elite] = asked[order[:elite]]

    def _crossed(self, parents: np.ndarray) -> np.ndarray:
        """Pairs of neighbours replaced by their two children, about the same mean, gene by gene near or far apart."""
        first, second = parents[::2], parents[1::2]
        u = self._rng.uniform(size=first.shape)
        power = 1.0 / (self._rules.eta + 1.0)
        beta = np.where(u <= 0.5, (2.0 * u) ** power, (0.5 / (1.0 - u)) ** power)
        crossed = self._rng.uniform(size=(len(first), 1)) < self._rules.crossover
        mean, apart = 0.5 * (first + second), 0.5 * beta * (first - second)
        out = parents.copy()
        out[::2] = np.where(crossed, mean + apart, first)
        out[1::2] = np.where(crossed, mean - apart, second)
        return np.clip(out, 0.0, 1.0)

    def _mutated(self, genes: np.ndarray) -> np.ndarray:
        """Every gene moved with the chance of a mutation; those of width 1 are drawn anew."""
        hit = self._rng.uniform(size=genes.shape) < self._rules.mutation
        draw = self._rng.uniform(size=genes.shape)
        moved = np.where(self._width >= 1.0, draw, genes + self._width * (2.0 * draw - 1.0))
        return np.clip(np.where(hit, moved, genes), 0.0, 1.0)


def begin(start: Start) -> Genetic:
    """A small population, for budgets of hundreds; what is known is in it, and the best one stays.

    One gene in P is moved: crossing a few candidates alone would soon make them all alike.
    """
    mutation = max(1.0 / start.dimensions, PUBLISHED.mutation)
    rules = Rules(population=start.batch, tournament=3, mutation=mutation, elite=1)
    return Genetic(start.dimensions, rng=start.rng, rules=rules, start=start.point)

"""Genetic algorithms on bits by ask and tell, in the unit cube: the operon algorithm of paper C, and a plain one.

The plain one with a roulette is that of paper B. Details of the operon algorithm that the paper does not print are
ours: see `Operon`.
"""

from abc import abstractmethod

import numpy as np

from dynreg.errors import UsageError
from dynreg.search.selection import Roulette, Selection, Tournament
from dynreg.search.start import Start
from dynreg.search.turns import Turns, ranked

BITS = 10  # of a number, usually
BYTE = 8  # of a number, in paper B
USUAL = Tournament()
LIST = 6  # values of a locus at most
CROSSOVER = 0.7  # of the plain one's children have two parents: our choice
CHANCES = (0.3, 0.3, 0.6, 0.3, 0.3)  # of connection, division, duplication, deletion, inversion


def numbers(bits: np.ndarray, digits: int = BITS) -> np.ndarray:
    """(..., P) in the unit cube of bits (..., digits P), the highest first."""
    weights = 2.0 ** np.arange(digits - 1, -1, -1)
    return bits.reshape(*bits.shape[:-1], -1, digits) @ weights / (2.0**digits - 1.0)


def grid(digits: int = BITS) -> float:
    """How far apart the numbers are that so many bits can tell."""
    return 1.0 / (2.0**digits - 1.0)


def coded(points: np.ndarray, digits: int = BITS) -> np.ndarray:
    """(..., digits P) bits of the numbers nearest to points (..., P) in the unit cube: the inverse of `numbers`."""
    levels = np.rint(np.clip(points, 0.0, 1.0) * (2.0**digits - 1.0)).astype(np.int64)
    bits = levels[..., None] >> np.arange(digits - 1, -1, -1) & 1
    return bits.reshape(*points.shape[:-1], -1).astype(np.uint8)


class _Bits(Turns):
    """What both have in common: parents are chosen, and the best go on as they are.

    bits : (population, digits P) of the generation.
    """

    bits: np.ndarray

    def __init__(
        self,
        dimensions: int,
        *,
        rng: np.random.Generator,
        population: int = 50,
        selection: Selection = USUAL,
        elite: int = 1,
        mutation: float | None = None,
        digits: int = BITS,
        seeds: np.ndarray | None = None,
    ):
        """The first generation.

        dimensions : numbers of a candidate. rng : of all draws. population : candidates of one ask. selection : how
        parents are chosen. elite : the best so many go on unchanged. mutation : chance of every value to turn; None
        for one expressed bit of all on average. digits : bits of a number. seeds : (n, P) the first candidates, to
        the nearest code; the others are random. Raises UsageError for sizes that do not fit each other.
        """
        known = 0 if seeds is None else len(seeds)
        if population < 1 or not 0 <= elite < population or known > population or digits < 1:
            raise UsageError(
                f"population {population}, elite {elite}, {known} seeds, {digits} digits",
                expected="at least 1 candidate and 1 digit, a smaller elite, and no more seeds than candidates",
                do="correct them",
            )
        self._rng, self._size, self._selection, self._elite = rng, population, selection, elite
        self._digits, self._loci = digits, digits * dimensions
        self._mutation = 1.0 / self._loci if mutation is None else mutation
        self._begin()
        if known:
            self.bits[:known] = coded(seeds, digits)

    def candidates(self) -> np.ndarray:
        """(population, P) the generation."""
        return numbers(self.bits, self._digits)

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """The next generation is bred from those that are selected; a loss that is NaN is the worst."""
        order, places = ranked(losses, self._rng)
        self.breed(self._selection.parents(losses, places, self._rng), order[: self._elite])

    @abstractmethod
    def _begin(self) -> None:
        """Draw the first generation, into `bits`."""

    @abstractmethod
    def breed(self, parents: np.ndarray, elite: np.ndarray) -> None:
        """Replace the generation by children of `parents` (population,); the first are `elite`, unchanged."""


class BitGenetic(_Bits):
    """The plain one: two-point crossover of bits in `CROSSOVER` of the children, and mutation."""

    def _begin(self) -> None:
        self.bits = self._rng.integers(2, size=(self._size, self._loci), dtype=np.uint8)

    def breed(self, parents: np.ndarray, elite: np.ndarray) -> None:
        kept, children = self.bits[elite], self.bits[parents]
        cuts = np.sort(self._rng.integers(self._loci + 1, size=(self._size, 2)), axis=1)
        at = np.arange(self._loci)
        mixed = (at >= cuts[:, :1]) & (at < cuts[:, 1:]) & (self._rng.random((self._size, 1)) < CROSSOVER)
        children = np.where(mixed, self.bits[self._rng.permutation(parents)], children)
        children ^= (self._rng.random(children.shape) < self._mutation).astype(np.uint8)
        children[: self._elite] = kept
        self.bits = children


class Operon(_Bits):
    """The operon algorithm: loci are linked in operons, and hold lists of bits of which the first is expressed.

    No crossover. Each child undergoes, each by its own chance: connection (two neighbouring operons become one),
    division (one becomes two), duplication (in an operon, every list gets a copy of its first value behind it),
    deletion (every list of an operon that has more than one loses one), inversion (the lists of an operon are turned
    round, which expresses what was hidden). Every value, hidden ones too, turns by mutation.

    An elite is optional in the paper, which gives the chances.
    """

    def _begin(self) -> None:
        shape = (self._size, self._loci)
        self._values = np.zeros((*shape, LIST), dtype=np.uint8)
        self._values[:, :, 0] = self._rng.integers(2, size=shape)
        self._length = np.ones(shape, dtype=np.int64)
        self._ends = np.ones(shape, dtype=bool)  # whether an operon ends behind a locus
        self.bits = self._values[:, :, 0]  # a view: what is written there is expressed

    def breed(self, parents: np.ndarray, elite: np.ndarray) -> None:
        kept = [a[elite] for a in (self._values, self._length, self._ends)]
        self._values, self._length, self._ends = (
            a[parents] for a in (self._values, self._length, self._ends)
        )
        steps = (self._connect, self._divide, self._duplicate, self._delete, self._invert)
        for child in range(self._elite, self._size):
            for step, chance in zip(steps, CHANCES, strict=True):
                if self._rng.random() < chance:
                    step(child)
        there = np.arange(LIST) < self._length[:, :, None]
        turned = self._rng.random(self._values.shape) < self._mutation
        self._values ^= (turned & there).astype(np.uint8)
        for own, best in zip((self._values, self._length, self._ends), kept, strict=True):
            own[: self._elite] = best
        self.bits = self._values[:, :, 0]

    def _operon(self, child: int) -> np.ndarray:
        """Loci of a random operon."""
        ends = np.flatnonzero(self._ends[child])
        pick = int(self._rng.integers(len(ends)))
        return np.arange(0 if pick == 0 else ends[pick - 1] + 1, ends[pick] + 1)

    def _connect(self, child: int) -> None:
        between = np.flatnonzero(self._ends[child, :-1])
        if len(between):
            self._ends[child, self._rng.choice(between)] = False

    def _divide(self, child: int) -> None:
        inside = np.flatnonzero(~self._ends[child])
        if len(inside):
            self._ends[child, self._rng.choice(inside)] = True

    def _duplicate(self, child: int) -> None:
        loci = self._operon(child)
        loci = loci[self._length[child, loci] < LIST]
        values = self._values[child, loci]
        self._values[child, loci, 1:] = values[:, :-1]  # the first stays, its copy stands behind it
        self._length[child, loci] += 1

    def _delete(self, child: int) -> None:
        loci = self._operon(child)
        for locus in loci[self._length[child, loci] > 1]:
            gone, length = int(self._rng.integers(self._length[child, locus])), self._length[child, locus]
            row = self._values[child, locus]
            row[gone : length - 1] = row[gone + 1 : length]
            row[length - 1] = 0
            self._length[child, locus] -= 1

    def _invert(self, child: int) -> None:
        loci = self._operon(child)
        length = self._length[child, loci][:, None]
        at = np.arange(LIST)
        source = np.where(at < length, length - 1 - at, at)
        self._values[child, loci] = np.take_along_axis(self._values[child, loci], source, axis=1)


SMALL = Tournament(3)  # of a small population


def begin_plain(start: Start) -> BitGenetic:
    """A small population, for budgets of hundreds; what is known is one of the first generation."""
    return BitGenetic(
        start.dimensions, rng=start.rng, population=start.batch, selection=SMALL, seeds=_of(start)
    )


def begin_operon(start: Start) -> Operon:
    """The same of the operon algorithm."""
    return Operon(start.dimensions, rng=start.rng, population=start.batch, selection=SMALL, seeds=_of(start))


def _of(start: Start) -> np.ndarray | None:
    """(1, P) what is known, None where nothing is."""
    return None if start.point is None else start.point[None]


def roulette(
    dimensions: int,
    rng: np.random.Generator,
    population: int,
    seeds: np.ndarray | None = None,
    mutation: float = 0.005,
) -> BitGenetic:
    """Paper B's, in which seeds (n, P) are the first of the first generation."""
    return BitGenetic(
        dimensions,
        rng=rng,
        population=population,
        selection=Roulette(),
        elite=0,
        mutation=mutation,
        digits=BYTE,
        seeds=seeds,
    )


def begin_roulette(start: Start) -> BitGenetic:
    """The same, in which what is known is one of the first generation."""
    return roulette(start.dimensions, start.rng, start.batch, _of(start))

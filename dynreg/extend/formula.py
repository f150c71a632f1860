"""Numbers that parameters make: sums of products of their powers, traced through the code that simulates."""

from collections.abc import Iterator, Mapping
from functools import reduce
from typing import Any

Powers = tuple[tuple[str, float], ...]  # (name, power) of each parameter in a product, by name


class Untold(Exception):
    """What is done to a formula leaves no sum of products of powers."""


class Formula:
    """A sum of products of powers of parameters; numpy calls its operators in arrays of objects.

    terms : {powers: factor}. ranges : {name: (low, high)} of each parameter, by which comparisons are decided.
    """

    __array_ufunc__ = None  # a numpy number beside it leaves the operation to it

    def __init__(self, terms: Mapping[Powers, float], ranges: Mapping[str, tuple[float, float]]):
        self.terms, self.ranges = terms, ranges

    @classmethod
    def of(cls, name: str, ranges: Mapping[str, tuple[float, float]]) -> "Formula":
        """The parameter itself."""
        return cls({((name, 1.0),): 1.0}, ranges)

    @property
    def names(self) -> frozenset[str]:
        """Of the parameters in it."""
        return frozenset(name for powers in self.terms for name, _ in powers)

    def value(self, values: Mapping[str, float]) -> float:
        """The number that parameters make."""
        return sum(
            factor * _product(values[name] ** power for name, power in powers)
            for powers, factor in self.terms.items()
        )

    def __add__(self, other: Any) -> "Formula":
        terms = dict(self.terms)
        for powers, factor in self._lifted(other).terms.items():
            terms[powers] = terms.get(powers, 0.0) + factor
        return Formula({powers: factor for powers, factor in terms.items() if factor != 0.0}, self.ranges)

    def __mul__(self, other: Any) -> "Formula":
        products = (
            Formula({_joined(mine, yours): a * b}, self.ranges)
            for mine, a in self.terms.items()
            for yours, b in self._lifted(other).terms.items()
        )
        return reduce(Formula.__add__, products, Formula({}, self.ranges))

    def __pow__(self, power: Any) -> "Formula":
        if len(self.terms) != 1:
            raise Untold("a power of a sum, or a division by one")
        ((powers, factor),) = self.terms.items()
        return Formula({tuple((name, p * power) for name, p in powers): factor**power}, self.ranges)

    def __neg__(self) -> "Formula":
        return self * -1.0

    def __sub__(self, other: Any) -> "Formula":
        return self + -self._lifted(other)

    def __rsub__(self, other: Any) -> "Formula":
        return -self + other

    def __truediv__(self, other: Any) -> "Formula":
        return self * self._lifted(other) ** -1.0

    def __rtruediv__(self, other: Any) -> "Formula":
        return self**-1.0 * other

    __radd__, __rmul__ = __add__, __mul__

    def __lt__(self, other: Any) -> bool:
        return self._sign(other, strict=False) < 0

    def __le__(self, other: Any) -> bool:
        return self._sign(other, strict=True) < 0

    def __gt__(self, other: Any) -> bool:
        return not self <= other

    def __ge__(self, other: Any) -> bool:
        return not self < other

    def _lifted(self, other: Any) -> "Formula":
        return (
            other if isinstance(other, Formula) else Formula({(): float(other)} if other else {}, self.ranges)
        )

    def _sign(self, other: Any, strict: bool) -> int:
        """-1 where it is below another everywhere (or equal, if strict), 1 where it never is; else Untold."""
        low, high = _bounds(self - other)
        if high < 0 or (strict and high <= 0):
            return -1
        if low > 0 or (not strict and low >= 0):
            return 1
        raise Untold("a comparison that has another answer in other parts of the range")


def _joined(mine: Powers, yours: Powers) -> Powers:
    """The powers of a product of two products."""
    powers = dict(mine)
    for name, power in yours:
        powers[name] = powers.get(name, 0.0) + power
    return tuple(sorted((name, power) for name, power in powers.items() if power))


def _bounds(found: Formula) -> tuple[float, float]:
    """Numbers between which a formula lies while its parameters are in their ranges."""
    low = high = 0.0
    for powers, factor in found.terms.items():
        least, most = factor, factor
        for name, power in powers:
            ends = found.ranges[name]
            if ends[0] < 0 < ends[1] and power != 1.0:
                raise Untold("a power of what may be negative")
            reach = [one * end**power for one in (least, most) for end in ends]
            least, most = min(reach), max(reach)
        low, high = low + least, high + most
    return low, high


def _product(numbers: Iterator[float]) -> float:
    return reduce(lambda a, b: a * b, numbers, 1.0)

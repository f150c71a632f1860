"""What an index knows of the things it orders: how many there are, and how far apart two of them lie."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from dynreg.arrays import Distances, Ids

To = Callable[[Ids], Distances]
"""A query that is no node yet: from ids (m,) to its distances to them (m,), in one batched call."""

ToMany = Callable[[Ids, Ids], Distances]
"""Many queries at once: from rows (m,), which query, and ids (m,) to the distances (m,)."""


@runtime_checkable
class Distance(Protocol):
    """Dissimilarity between nodes 0 .. len-1. No triangle inequality and no zero on the diagonal is asked
    for; smaller means nearer. A call has a fixed cost, so callers ask for many pairs at once."""

    def __len__(self) -> int:
        """How many nodes there are."""
        ...

    def pairs(self, a: Ids, b: Ids) -> Distances:
        """Distances a[i] to b[i]: (m,), (m,) -> (m,)."""
        ...


class Counted:
    """A symmetric distance that remembers: a pair is evaluated, and counted, once.

    evaluations : pairs evaluated since the beginning; (a, b) and (b, a) are the same one.
    """

    def __init__(self, distance: Distance):
        self.distance = distance
        self.evaluations = 0
        self._known: dict[int, float] = {}

    def __len__(self) -> int:
        return len(self.distance)

    def pairs(self, a: Ids, b: Ids) -> Distances:
        a, b = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64)
        keys = (np.minimum(a, b) << 31) | np.maximum(a, b)  # one integer for each pair; ids stay below 2**31
        unknown, first = np.unique(keys, return_index=True)
        first = first[[key not in self._known for key in unknown.tolist()]]
        if len(first):
            found = self.distance.pairs(a[first], b[first])
            self._known.update(zip(keys[first].tolist(), np.asarray(found).tolist(), strict=True))
            self.evaluations += len(first)
        return np.array([self._known[key] for key in keys.tolist()], dtype=np.float64)

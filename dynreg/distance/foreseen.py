"""The entries nearest to a recording, found by foreseeing from embeddings what each model would miss.

An embedding is linear in what a model predicts on shared probes. What a model misses on the rows of a recording is
nearly linear in its embedding: a ridge map, fitted to the entries that were judged so far, foresees it for the others.
Those that are foreseen to miss least are judged next, and the map is fitted again with them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.distance.query import Ranked, in_order

SETTLED = 2  # rounds that must leave the nearest ones as they are, before a search ends
SETTLED_ON = 5  # nearest ones that are watched
AROUND = 8  # of the best, whose mean place says which others are worth foreseeing
# An entry says nothing of the near ones if it is farther than FAR times the nearest distance. A nearest distance below
# 1 counts as 1, or one that misses nearly nothing would leave none to learn from. With 5 and with 10 searches by
# cross-loss find the same.
FAR = 10.0


@dataclass(frozen=True)
class Effort:
    """How a search spends its judgements.

    least : entries that are judged in any case. near : of the others, so many are foreseen. ridge : in units of the
    variance of a place, summed over its coordinates. each : entries that are judged before the map is fitted again.
    """

    least: int
    near: int
    ridge: float
    each: int = 32


Missed = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What entries (m,) miss, weighted (m, F), and their distances (m,); infinite where a prediction is no number.

What stands for misses may be one positive number that grows with the distance, (m, 1).
"""


def seek(places: np.ndarray, missed: Missed, wanted: int, first: np.ndarray, effort: Effort) -> Ranked:
    """Entries in order of their distance, those that were judged: at least `wanted`, where there are so many.

    places : (M, D') what is known of all entries, their embeddings. first : (m,) those that are judged first.
    """
    places, new = np.asarray(places, dtype=np.float32), np.unique(first)
    ids, far, misses = new[:0], np.zeros(0), np.zeros((0, 0), dtype=np.float32)
    left = np.ones(len(places), dtype=bool)
    best, settled = far, 0
    while len(new):
        miss, distance = missed(new)
        left[new] = False
        misses = np.concatenate([misses, miss]) if len(ids) else miss
        ids, far = np.concatenate([ids, new]), np.concatenate([far, distance])
        before, best = best, np.sort(far)[:SETTLED_ON]
        settled = settled + 1 if np.array_equal(before, best) and np.isfinite(best[0]) else 0
        if len(ids) >= max(effort.least, wanted) and settled >= SETTLED:
            break
        new = _next(places, ids, misses, far, np.flatnonzero(left), effort)
    return in_order(ids, far, len(ids))


def _next(
    places: np.ndarray,
    ids: np.ndarray,
    misses: np.ndarray,
    far: np.ndarray,
    others: np.ndarray,
    effort: Effort,
) -> np.ndarray:
    """Those of `others` that are foreseen to miss least, by what the judged `ids` (m,) missed (m, F)."""
    sound = far < FAR * max(1.0, far.min(initial=np.inf))
    if not sound.any() or not len(others):
        return others[: effort.each]
    if not sound.all():
        ids, misses, far = ids[sound], misses[sound], far[sound]
    centre = places[ids[np.argsort(far, kind="stable")[:AROUND]]].mean(axis=0)
    apart = np.square(places[others] - centre).sum(axis=1)
    near = others[np.sort(np.argsort(apart, kind="stable")[: effort.near])]
    foreseen = _foreseen(places[ids], misses, places[near], effort.ridge)
    return np.sort(near[np.argsort(foreseen, kind="stable")[: effort.each]])


def _foreseen(known: np.ndarray, misses: np.ndarray, places: np.ndarray, ridge: float) -> np.ndarray:
    """(n,) sums of absolute misses at these places (n, D'), by ridge from those `known` (m, D') with theirs (m, F)."""
    import torch

    x, y, z = (torch.from_numpy(np.ascontiguousarray(a)) for a in (known, misses, places))
    middle, level = x.mean(0), y.mean(0)
    x = x - middle
    gram = x.T @ x
    gram.diagonal().add_(ridge * gram.trace() / len(x) + 1e-9)
    # the level of y falls out, for x is centred; gram is small and well conditioned by its ridge: its inverse does
    slope = torch.linalg.inv(gram) @ (x.T @ y)
    return torch.addmm(level, z - middle, slope).abs_().sum(1).numpy()

"""The entries nearest to a recording, found by foreseeing from embeddings what each model would miss.

An embedding is linear in what a model predicts on shared probes. What a model misses on the rows of a recording is
nearly linear in its embedding: a ridge map, fitted to the entries that were judged so far, foresees it for the others.
Where it is not, a Gaussian process does. Those that are foreseen to miss least are judged next, and some that lie
beside the best. Then all is foreseen again.
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
BEST = 3  # of the judged, whose neighbours by place are judged beside those that are foreseen

# Variance of a process' level beside that of its slope: the mean of the judged is not that of all. Without it the
# search finds three of the five nearest of one servo of two among 30,000.
LEVEL = 10.0

Foresee = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""What the entries (n,) will miss, (n,), by what the judged ones (m,) missed, (m, F)."""


@dataclass(frozen=True)
class Effort:
    """How a search spends its judgements.

    foresee : by the places (M, D') of all entries gives what foresees. least : entries that are judged in any case.
    near : of the others, so many are foreseen, those nearest to the best. each : entries that are judged before all is
    foreseen again. beside : share of these that are those next to the best.
    """

    foresee: Callable[[np.ndarray], Foresee]
    least: int
    near: int = 2**31
    each: int = 32
    beside: float = 0.0


Missed = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What entries (m,) miss, weighted (m, F), and their distances (m,); infinite where a prediction is no number.

What stands for misses may be one positive number that grows with the distance, (m, 1).
"""


def seek(places: np.ndarray, missed: Missed, wanted: int, first: np.ndarray, effort: Effort) -> Ranked:
    """Entries in order of their distance, those that were judged: at least `wanted`, where there are so many.

    places : (M, D') what is known of all entries, their embeddings. first : (m,) those that are judged first.
    """
    places, new = np.asarray(places, dtype=np.float32), np.unique(first)
    foresee = effort.foresee(places)
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
        new = _next(places, ids, misses, far, np.flatnonzero(left), effort, foresee)
    return in_order(ids, far, len(ids))


def _next(
    places: np.ndarray,
    ids: np.ndarray,
    misses: np.ndarray,
    far: np.ndarray,
    others: np.ndarray,
    effort: Effort,
    foresee: Foresee,
) -> np.ndarray:
    """Those of `others` that are foreseen to miss least, by what the judged `ids` (m,) missed (m, F)."""
    sound = far < FAR * max(1.0, far.min(initial=np.inf))
    if not sound.any() or not len(others):
        return others[: effort.each]
    if not sound.all():
        ids, misses, far = ids[sound], misses[sound], far[sound]
    near, best = others, places[ids[np.argsort(far, kind="stable")[:AROUND]]]
    if effort.near < len(others):
        apart = np.square(places[others] - best.mean(axis=0)).sum(axis=1)
        near = others[np.sort(np.argsort(apart, kind="stable")[: effort.near])]
    order = near[np.argsort(foresee(ids, misses, near), kind="stable")]
    beside = round(effort.beside * effort.each)
    foreseen, rest = np.split(order, [effort.each - beside])
    if beside:
        apart = np.square(places[rest][:, None] - best[:BEST]).sum(axis=2).min(axis=1)
        foreseen = np.append(foreseen, rest[np.argsort(apart, kind="stable")[:beside]])
    return np.sort(foreseen)


def linear(ridge: float) -> Callable[[np.ndarray], Foresee]:
    """Sums of absolute misses, by a ridge map. ridge : in units of the variance of a place, summed over coordinates."""

    def mapped(places: np.ndarray) -> Foresee:
        import torch

        def foresee(ids: np.ndarray, misses: np.ndarray, others: np.ndarray) -> np.ndarray:
            x, y, z = (
                torch.from_numpy(np.ascontiguousarray(a)) for a in (places[ids], misses, places[others])
            )
            middle, level = x.mean(0), y.mean(0)
            x = x - middle
            gram = x.T @ x
            gram.diagonal().add_(ridge * gram.trace() / len(x) + 1e-9)
            # the level of y falls out, for x is centred. Gram is small, and its ridge keeps it well conditioned, so its
            # inverse will do.
            slope = torch.linalg.inv(gram) @ (x.T @ y)
            return torch.addmm(level, z - middle, slope).abs_().sum(1).numpy()

        return foresee

    return mapped


def gaussian(reach: float, noise: float, slope: float) -> Callable[[np.ndarray], Foresee]:
    """The mean of a Gaussian process of misses (m, 1), by a squared exponential and a linear kernel.

    reach : of the first, in units of places. noise : variance of a miss about the mean, and slope : weight of the
    second kernel, both in units of the variance of misses.
    """

    def process(places: np.ndarray) -> Foresee:
        import torch

        every = torch.from_numpy(places)
        size = every.square().sum(1)

        def likeness(together: torch.Tensor, first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
            apart = (first[:, None] + second - 2.0 * together).clamp_min_(0.0)
            return apart.mul_(-0.5 / reach**2).exp_().add_(together + LEVEL, alpha=slope)

        alike: list[torch.Tensor] = []  # (m, M) how much the judged of each round are like every entry
        row: dict[int, int] = {}  # of each that was judged, in all of these

        def foresee(ids: np.ndarray, misses: np.ndarray, others: np.ndarray) -> np.ndarray:
            new = np.array([i for i in ids.tolist() if i not in row], dtype=np.int64)
            row.update(zip(new.tolist(), range(len(row), len(row) + len(new)), strict=True))
            alike.append(likeness(every[new] @ every.T, size[new], size))
            rows = [row[i] for i in ids.tolist()]
            missed = torch.from_numpy(misses[:, 0]).double()
            level, spread = missed.mean(), missed.std(correction=0).clamp_min(1e-12)
            judged = every[ids].double()  # what a rounding of their likeness changes, the solution multiplies
            own = judged.square().sum(1)
            gram = likeness(judged @ judged.T, own, own)
            gram.diagonal().add_(noise)
            solved = torch.cholesky_solve(((missed - level) / spread)[:, None], torch.linalg.cholesky(gram))
            weight = torch.zeros(len(row))  # one that was judged may be too far to learn from
            weight[rows] = solved[:, 0].float()
            parts = zip(weight.split([len(part) for part in alike]), alike, strict=True)
            return sum(some @ part for some, part in parts)[others].numpy()

        return foresee

    return process

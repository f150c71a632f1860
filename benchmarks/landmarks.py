"""Search by landmarks: an entry is described by its log-distances to m fixed entries.

A query is measured against the landmarks alone. One ridge regression for each entry then predicts the log
of the query's distance to it from that description, and the most promising entries are measured truly.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from dynreg.arrays import Distances, Ids
from dynreg.errors import UsageError
from dynreg.index import Distance, Found, ToMany
from dynreg.rng import stream

Score = Callable[["Landmarks", Float[ndarray, "Q M"]], Float[ndarray, "Q N"]]
"""From log-distances of queries to the landmarks to what ranks the entries, smallest first."""

PENALTIES = np.geomspace(1e-6, 10.0, 22)
"""Ridge penalties tried, in units of the mean squared singular value of the descriptions."""


@dataclass(frozen=True)
class Landmarks:
    """Descriptions of n entries by m landmarks, and what predicts distances from them.

    Attributes
    ----------
    ids : (m,) the entries that serve as landmarks.
    symmetric : whether d(a, b) = d(b, a); if not, both ways are measured.
    outward : (n, m) log d(entry, landmark): the entry as a query sees the landmarks.
    inward : (m, n) log d(landmark, entry): each landmark as a query sees the entries.
    centre : (m,) mean description of the landmarks themselves, their own column left out.
    weights : (m + 1, n) one ridge regression for each entry, its constant last.
    penalty : of the ridge, chosen by leaving one landmark out.
    """

    ids: ndarray
    symmetric: bool
    outward: ndarray
    inward: ndarray
    centre: ndarray
    weights: ndarray
    penalty: float

    def __len__(self) -> int:
        return len(self.outward)

    def predict(self, logs: Float[ndarray, "Q M"]) -> Float[ndarray, "Q N"]:
        """Log-distances (Q, n) to all entries, of queries whose log-distances to the landmarks are `logs`
        (Q, m)."""
        predicted = (logs - self.centre) @ self.weights[:-1] + self.weights[-1]
        predicted[:, self.ids] = logs
        return predicted

    def apart(self, logs: Float[ndarray, "Q M"]) -> Float[ndarray, "Q N"]:
        """Euclidean distances (Q, n) between descriptions: the plain alternative to `predict`."""
        squares = np.sum(logs**2, axis=1)[:, None] + np.sum(self.outward**2, axis=1)
        return np.sqrt(np.maximum(squares - 2.0 * logs @ self.outward.T, 0.0))


def build_landmarks(
    distance: Distance,
    n: int,
    *,
    seed: int = 0,
    m: int = 128,
    farthest: bool = False,
    symmetric: bool = True,
) -> Landmarks:
    """Choose landmarks among entries 0 .. n-1, at random or each the farthest from those before it, and
    measure everyone against them (n m evaluations, twice that where the distance is not symmetric).

    Raises
    ------
    UsageError : no entries, more entries than the distance has, a distance that is not positive and finite.
    """
    if not 1 <= n <= len(distance) or m < 1:
        raise UsageError(
            f"{m} landmarks among {n} entries of {len(distance)}",
            expected="at least one landmark, and 1 entry up to as many as have distances",
            do="register entries first",
        )
    rng = stream(seed, "landmarks")
    if farthest:
        ids = _spread(distance, n, min(m, n), int(rng.integers(n)))
    else:
        ids = np.sort(rng.choice(n, size=min(m, n), replace=False))
    outward, inward = _describe(distance, np.arange(n), ids, symmetric)
    design, targets = _without_self(outward[ids], inward, ids)
    centre = design.mean(axis=0)
    weights, penalty = _ridge(design - centre, targets, None)
    return Landmarks(ids, symmetric, outward, inward, centre, weights, penalty)


def extend_landmarks(landmarks: Landmarks, distance: Distance, n: int) -> Landmarks:
    """Describe the entries up to n - 1 too; landmarks, penalty and the entries so far stay as they are."""
    new = np.arange(len(landmarks), n)
    outward, inward = _describe(distance, new, landmarks.ids, landmarks.symmetric)
    design, _ = _without_self(landmarks.outward[landmarks.ids], landmarks.inward, landmarks.ids)
    weights, _ = _ridge(design - landmarks.centre, inward, landmarks.penalty)
    return replace(
        landmarks,
        outward=np.concatenate([landmarks.outward, outward]),
        inward=np.concatenate([landmarks.inward, inward], axis=1),
        weights=np.concatenate([landmarks.weights, weights], axis=1),
    )


def refine(landmarks: Landmarks, a: Ids, b: Ids, distances: Distances) -> Landmarks:
    """Teach the regressions of entries `b` (t,) the known distances of entries `a` (t,) to them, for example
    the links of a graph, besides what the landmarks say. Pairs with a landmark as `a` are known already, and
    no entry learns from itself: both are left out."""
    fresh = ~np.isin(a, landmarks.ids) & (a != b)
    if not fresh.any():
        return landmarks
    a, b, logs = a[fresh], b[fresh], _log(distances[fresh], a[fresh], b[fresh])
    own, targets = _without_self(landmarks.outward[landmarks.ids], landmarks.inward, landmarks.ids)
    design = np.column_stack([own - landmarks.centre, np.ones(len(own))])
    described = np.column_stack([landmarks.outward - landmarks.centre, np.ones(len(landmarks))])
    gram = design.T @ design + landmarks.penalty * np.diag(np.arange(len(own) + 1) < len(own))
    weights = landmarks.weights.copy()
    order = np.argsort(b, kind="stable")
    entries, first = np.unique(b[order], return_index=True)
    for entry, rows in zip(entries, np.split(order, first[1:]), strict=True):
        seen = described[a[rows]]
        known = design.T @ targets[:, entry] + seen.T @ logs[rows]
        weights[:, entry] = np.linalg.solve(gram + seen.T @ seen, known)
    return replace(landmarks, weights=weights)


def search_landmarks(
    landmarks: Landmarks,
    to: ToMany,
    queries: int,
    k: int,
    *,
    rerank: int = 50,
    score: Score = Landmarks.predict,
) -> list[Found]:
    """The k nearest of the m landmarks and the `rerank` other entries with the best score, by true distance.

    Every query costs m + rerank evaluations; all queries share two calls of `to(rows, ids)`.
    """
    rows, m = np.arange(queries), len(landmarks.ids)
    measured = np.asarray(to(np.repeat(rows, m), np.tile(landmarks.ids, queries)), dtype=np.float64)
    measured = measured.reshape(queries, m)
    scores = score(landmarks, _log(measured, rows, landmarks.ids))
    scores[:, landmarks.ids] = np.inf
    count = min(rerank, len(landmarks) - m)
    promising = np.argsort(scores, axis=1, kind="stable")[:, :count]
    exact = np.asarray(to(np.repeat(rows, count), promising.reshape(-1)), dtype=np.float64)
    ids = np.concatenate([np.broadcast_to(landmarks.ids, (queries, m)), promising], axis=1)
    distances = np.concatenate([measured, exact.reshape(queries, count)], axis=1)
    found = []
    for row in rows:
        best = np.lexsort((ids[row], distances[row]))[:k]
        found.append(Found(ids[row, best], distances[row, best], m + count))
    return found


def _describe(
    distance: Distance, new: Int[ndarray, " N"], ids: Int[ndarray, " M"], symmetric: bool
) -> tuple[Float[ndarray, "N M"], Float[ndarray, "M N"]]:
    """Log-distances (new, m) to the landmarks and (m, new) from them."""
    inward = np.array([distance.pairs(np.full(len(new), landmark), new) for landmark in ids.tolist()])
    inward = _log(inward.reshape(len(ids), len(new)), ids, new)
    if symmetric:
        return inward.T.copy(), inward
    outward = np.array([distance.pairs(np.full(len(ids), entry), ids) for entry in new.tolist()])
    return _log(outward.reshape(len(new), len(ids)), new, ids), inward


def _log(distances: ndarray, a: ndarray, b: ndarray) -> ndarray:
    """`a` numbers the rows and `b` the columns (or the same rows) of `distances`, for the message."""
    distances = np.asarray(distances, dtype=np.float64)
    good = np.isfinite(distances) & (distances > 0)
    if not good.all():
        at = np.unravel_index(np.argmin(good), good.shape)
        raise UsageError(
            f"the distance {distances[at]} from {a[at[0]]} to {b[at[-1]]}",
            expected="positive finite distances, for their logarithms are compared",
            do="leave out the entries whose model diverged",
        )
    return np.log(distances)


def _spread(distance: Distance, n: int, m: int, first: int) -> Ids:
    """Farthest-point sampling from `first`."""
    ids = [first]
    nearest = np.full(n, np.inf)
    while len(ids) < m:
        nearest = np.minimum(nearest, distance.pairs(np.full(n, ids[-1]), np.arange(n)))
        nearest[ids[-1]] = -np.inf
        ids.append(int(np.argmax(nearest)))
    return np.sort(np.array(ids, dtype=np.int64))


def _without_self(
    own: Float[ndarray, "M M"], inward: Float[ndarray, "M N"], ids: Int[ndarray, " M"]
) -> tuple[Float[ndarray, "M M"], Float[ndarray, "M N"]]:
    """The landmarks as training queries. No real query is itself an entry, so a landmark's distance to
    itself is replaced by what the other landmarks lead one to expect (a ridge without it)."""
    design, targets, m = own.copy(), inward.copy(), len(ids)
    for landmark in range(m if m > 2 else 0):
        others = np.delete(np.arange(m), landmark)
        rows, column = own[np.ix_(others, others)], own[others, landmark]
        centred = rows - rows.mean(axis=0)
        gram = centred.T @ centred
        gram[np.diag_indices(m - 1)] += 0.01 * np.trace(gram) / m + 1e-12
        slope = np.linalg.solve(gram, centred.T @ (column - column.mean()))
        design[landmark, landmark] = column.mean() + (own[landmark, others] - rows.mean(axis=0)) @ slope
        targets[landmark, ids[landmark]] = design[landmark, landmark]
    return design, targets


def _ridge(
    design: Float[ndarray, "M M"], targets: Float[ndarray, "M N"], penalty: float | None
) -> tuple[Float[ndarray, "{len(design)+1} N"], float]:
    """Weights (m + 1, n) of one ridge regression for each column of `targets` on the centred `design`, with
    the given penalty or the one whose leave-one-out error over all columns is least."""
    mean = targets.mean(axis=0)
    left, values, right = np.linalg.svd(design, full_matrices=False)
    projected = left.T @ (targets - mean)
    squares = values**2
    if penalty is None:
        errors = []
        for candidate in PENALTIES * (squares.mean() + 1e-12):
            shrink = squares / (squares + candidate)
            leverage = np.minimum(left**2 @ shrink + 1.0 / len(design), 1.0 - 1e-9)
            residual = targets - mean - left @ (shrink[:, None] * projected)
            errors.append((np.mean((residual / (1.0 - leverage)[:, None]) ** 2), candidate))
        penalty = float(min(errors)[1])
    slopes = right.T @ ((values / (squares + penalty))[:, None] * projected)
    return np.vstack([slopes, mean]), penalty

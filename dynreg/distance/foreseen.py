"""The entries nearest to a recording, found by foreseeing from embeddings what each model would miss.

An embedding is linear in what a model predicts on shared probes. What a model misses on the rows of a recording is
nearly linear in its embedding: a ridge map, fitted to the entries that were judged so far, foresees it for the others.
Those that are foreseen to miss least are judged next, and the map is fitted again with them.
"""

from collections.abc import Callable

import numpy as np

from dynreg.distance.query import Ranked, in_order

FIRST = 32  # random entries that are judged before anything is foreseen
ROUND = 32  # entries that are judged before the map is fitted again
LEAST = 160  # entries that are judged in any case,
SETTLED = 2  # and rounds that must leave the nearest ones as they are, before the search ends
SETTLED_ON = 5  # nearest ones that are watched
AROUND = 8  # of the best, whose mean embedding says which others are worth foreseeing,
NEAR = 500  # so many of the others
FEATURES = 64  # sequences of the recording on which misses are foreseen
WILD = 10.0  # times the base model's error: a model that misses more says nothing of the others
RIDGE = 1.0  # in units of the mean variance of an embedding's coordinates, summed over the entries

Missed = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""What entries (m,) miss, weighted (m, F), and their distances (m,); infinite where a prediction is no number."""


def seek(vectors: np.ndarray, missed: Missed, wanted: int, rng: np.random.Generator) -> Ranked:
    """Entries in order of their distance, those that were judged: at least `wanted`, where there are so many.

    vectors : (M, D') embeddings. rng : draws those that are judged first.
    """
    vectors = np.asarray(vectors, dtype=np.float32)
    new = np.sort(rng.permutation(len(vectors))[:FIRST])
    ids, far, misses = new[:0], np.zeros(0), np.zeros((0, 0), dtype=np.float32)
    left = np.ones(len(vectors), dtype=bool)
    best, settled = far, 0
    while len(new):
        miss, distance = missed(new)
        left[new] = False
        misses = np.concatenate([misses, miss]) if len(ids) else miss
        ids, far = np.concatenate([ids, new]), np.concatenate([far, distance])
        before, best = best, np.sort(far)[:SETTLED_ON]
        settled = settled + 1 if np.array_equal(before, best) and np.isfinite(best[0]) else 0
        if len(ids) >= max(LEAST, wanted) and settled >= SETTLED:
            break
        new = _next(vectors, ids, misses, far, np.flatnonzero(left))
    return in_order(ids, far, len(ids))


def _next(
    vectors: np.ndarray, ids: np.ndarray, misses: np.ndarray, far: np.ndarray, others: np.ndarray
) -> np.ndarray:
    """Those of `others` that are foreseen to miss least, by what the judged `ids` (m,) missed (m, F)."""
    sound = far < WILD
    if not sound.any() or not len(others):
        return others[:ROUND]
    if not sound.all():
        ids, misses, far = ids[sound], misses[sound], far[sound]
    centre = vectors[ids[np.argsort(far, kind="stable")[:AROUND]]].mean(axis=0)
    apart = np.square(vectors[others] - centre).sum(axis=1)
    near = others[np.sort(np.argsort(apart, kind="stable")[:NEAR])]
    foreseen = _foreseen(vectors[ids], misses, vectors[near])
    return np.sort(near[np.argsort(foreseen, kind="stable")[:ROUND]])


def _foreseen(known: np.ndarray, misses: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(n,) sums of absolute misses of models with these vectors (n, D'), by ridge from `known` (m, D') and (m, F)."""
    import torch

    x, y, z = (torch.from_numpy(np.ascontiguousarray(a)) for a in (known, misses, vectors))
    middle, level = x.mean(0), y.mean(0)
    x = x - middle
    gram = x.T @ x
    gram.diagonal().add_(RIDGE * gram.trace() / len(x) + 1e-9)
    slope = torch.linalg.solve(gram, x.T @ y)  # the level of y falls out, for x is centred
    return torch.addmm(level, z - middle, slope).abs_().sum(1).numpy()

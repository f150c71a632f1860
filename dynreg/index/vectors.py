"""Nearest neighbours among Euclidean vectors: exact in numpy, or approximate with hnswlib."""

import threading
from importlib.util import find_spec

import numpy as np

from dynreg.arrays import Vectors
from dynreg.errors import UsageError
from dynreg.rng import stream_seed

CHUNK = 1 << 22
"""Distances held at once by the exact search."""
LINKS = 16  # of a node on each layer of hnswlib's graph ("M")
KEPT_TO_INSERT, KEPT_TO_ANSWER = 200, 100  # candidates, while inserting and while querying


class ExactVectors:
    """Vectors of one dimension, numbered in the order in which they were added; equal distances are ordered by id.

    Brute force by one matrix product a block.
    """

    def __init__(self, dimensions: int):
        self._vectors = np.zeros((0, dimensions))
        self._squares = np.zeros(0)

    def __len__(self) -> int:
        return len(self._vectors)

    def add(self, vectors: np.ndarray) -> None:
        """Append vectors (m, D), which get the next m ids."""
        vectors = _checked(vectors, self._vectors.shape[1])
        self._vectors = np.concatenate([self._vectors, vectors])
        self._squares = np.concatenate([self._squares, np.sum(vectors**2, axis=1)])

    def nearest(self, queries: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Ids and Euclidean distances (Q, min(k, n)) of the nearest to `queries` (Q, D), nearest first."""
        queries = _checked(queries, self._vectors.shape[1])
        k = min(_positive(k), len(self))
        ids = np.zeros((len(queries), k), dtype=np.int64)
        distances = np.zeros((len(queries), k))
        step = max(1, CHUNK // max(1, len(self)))
        for at in range(0, len(queries) if k else 0, step):
            block = slice(at, at + step)
            ids[block], distances[block] = self._nearest(queries[block], k)
        return ids, distances

    def _nearest(self, queries: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The product only preselects, with a margin for its rounding; differences decide."""
        rough = self._squares - 2.0 * queries @ self._vectors.T
        wide = min(len(self), k + 16)
        ids = np.sort(np.argpartition(rough, wide - 1, axis=1)[:, :wide], axis=1)
        distances = np.linalg.norm(self._vectors[ids] - queries[:, None, :], axis=2)
        order = np.argsort(distances, axis=1, kind="stable")[:, :k]
        return np.take_along_axis(ids, order, 1), np.take_along_axis(distances, order, 1)


class HnswVectors:
    """The same by hnswlib's hierarchical graph (arXiv 1603.09320), built by one thread so that it is reproducible.

    hnswlib does not allow queries while it inserts: a lock keeps them apart.
    """

    def __init__(self, dimensions: int, *, seed: int = 0):
        import hnswlib

        self._dimensions = dimensions
        self._lock = threading.Lock()
        self._index = hnswlib.Index(space="l2", dim=dimensions)
        self._index.init_index(
            max_elements=1024,
            M=LINKS,
            ef_construction=KEPT_TO_INSERT,
            random_seed=stream_seed(seed, "hnsw") % (1 << 31),
        )

    def __len__(self) -> int:
        return self._index.get_current_count()

    def add(self, vectors: np.ndarray) -> None:
        """Append vectors (m, D), which get the next m ids."""
        vectors = _checked(vectors, self._dimensions)
        with self._lock:
            size = len(self) + len(vectors)
            if size > self._index.get_max_elements():
                self._index.resize_index(max(size, 2 * self._index.get_max_elements()))
            self._index.add_items(vectors.astype(np.float32), np.arange(len(self), size), num_threads=1)

    def nearest(self, queries: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Ids and Euclidean distances (Q, min(k, n)) of the nearest to `queries` (Q, D), nearest first."""
        queries = _checked(queries, self._dimensions)
        with self._lock:
            k = min(_positive(k), len(self))
            if not k or not len(queries):
                return np.zeros((len(queries), k), dtype=np.int64), np.zeros((len(queries), k))
            self._index.set_ef(max(KEPT_TO_ANSWER, k))
            ids, squares = self._index.knn_query(queries.astype(np.float32), k=k)
        ids, squares = ids.astype(np.int64), squares.astype(np.float64)
        order = np.lexsort((ids, squares), axis=1)
        distances = np.sqrt(np.take_along_axis(squares, order, 1))
        return np.take_along_axis(ids, order, 1), distances


def vector_index(dimensions: int, *, kind: str = "auto", seed: int = 0) -> ExactVectors | HnswVectors:
    """An empty index: `kind` is "exact", "hnsw", or "auto" for hnsw where hnswlib is installed.

    Raises
    ------
    UsageError : an unknown kind, or "hnsw" where hnswlib is not installed.
    """
    installed = find_spec("hnswlib") is not None
    if kind == "exact" or (kind == "auto" and not installed):
        return ExactVectors(dimensions)
    if kind in ("hnsw", "auto") and installed:
        return HnswVectors(dimensions, seed=seed)
    raise UsageError(
        f"no vector index {kind!r} here",
        expected="exact, hnsw or auto; hnsw needs hnswlib",
        do="install dynreg[hnsw], or use exact",
    )


def _checked(vectors: np.ndarray, dimensions: int) -> Vectors:
    vectors = np.asarray(vectors, dtype=np.float64)
    finite = np.isfinite(vectors).all()
    if vectors.ndim != 2 or vectors.shape[1] != dimensions or not finite:
        raise UsageError(
            f"vectors of shape {vectors.shape}" + ("" if finite else " with NaN or infinity"),
            expected=f"finite numbers of shape (rows, {dimensions})",
            do="pass one row for each vector",
        )
    return vectors


def _positive(k: int) -> int:
    if k < 1:
        raise UsageError(f"k = {k} neighbours", expected="at least 1", do="ask for more")
    return k

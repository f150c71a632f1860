"""Entries to test and tune an index on: distances known in full, and a made-up family with the cross-loss's bad habits.

Made-up entries have a position in parameter space and a noise of their own. A model's loss on another's data is
that data's noise plus what the positions differ by; own losses differ tenfold, so that the entries with
much noise seem near to everyone (hubs), d(a, a) = 1, and the triangle inequality does not hold.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.arrays import Distances, Ids
from dynreg.errors import UsageError
from dynreg.rng import stream


@dataclass(frozen=True)
class SyntheticEntries:
    """Entries with d(a, b) = [L_a(D_b) + L_b(D_a)] / [L_a(D_a) + L_b(D_b)] (paper D's cross-loss), where
    L_a(D_b) = noise_b + |W (p_a - p_b)|^2 gain_b + error_a.

    Attributes
    ----------
    positions : (n, dims) W p, the weighted parameters.
    noise : (n,) variance of the entry's own data, log-uniform over a decade.
    gain : (n,) how strongly the entry's data shows a difference in parameters.
    error : (n,) what the entry's model gets wrong everywhere.
    """

    positions: np.ndarray
    noise: np.ndarray
    gain: np.ndarray
    error: np.ndarray

    @classmethod
    def draw(cls, n: int, *, seed: int, dims: int = 10) -> "SyntheticEntries":
        """n entries with `dims` parameters in [0, 1], whose weights fall from 1 to 0.1."""
        rng = stream(seed, "synthetic entries")
        weights = np.geomspace(1.0, 0.1, dims)
        columns = rng.random((n, dims + 3))
        return cls(
            positions=columns[:, :dims] * weights,
            noise=10.0 ** (columns[:, dims] - 1.5),
            gain=0.5 + columns[:, dims + 1],
            error=0.01 * columns[:, dims + 2],
        )

    def __len__(self) -> int:
        return len(self.noise)

    def between(self, a: int, others: Ids) -> Distances:
        return self.pairs(np.full(len(others), a), others)

    def pairs(self, a: Ids, b: Ids) -> Distances:
        apart = np.sum((self.positions[a] - self.positions[b]) ** 2, axis=1)
        own = self.noise[a] + self.error[a] + self.noise[b] + self.error[b]
        return 1.0 + apart * (self.gain[a] + self.gain[b]) / own

    def matrix(self, queries: slice = slice(None), nodes: slice = slice(None)) -> np.ndarray:
        """Distances of `queries` to `nodes`, (Q, n)."""
        ids = np.arange(len(self))
        rows, columns = ids[queries], ids[nodes]
        table = [self.between(int(row), columns) for row in rows]
        return np.array(table).reshape(len(rows), len(columns))


class MatrixDistance:
    """A distance that is already known in full.

    Parameters
    ----------
    matrix : (n, n) or, for queries that are no nodes, (Q, n): entry [a, b] is the distance of a to b.

    Raises
    ------
    UsageError : the matrix is not two-dimensional or holds NaN.
    """

    def __init__(self, matrix: np.ndarray):
        matrix = np.asarray(matrix, dtype=np.float64)
        if matrix.ndim != 2:
            raise UsageError(
                f"a distance matrix of shape {matrix.shape}",
                expected="a table of shape (from, to)",
                do="pass one row for each node or query",
            )
        if np.isnan(matrix).any():
            row, column = np.argwhere(np.isnan(matrix))[0]
            raise UsageError(
                f"the distance from {row} to {column} is NaN",
                expected="a number for every pair",
                do="leave out the entries whose model diverged",
            )
        self.matrix = matrix

    def __len__(self) -> int:
        return self.matrix.shape[1]

    def between(self, a: int, others: Ids) -> Distances:
        return self.matrix[a, others]

    def pairs(self, a: Ids, b: Ids) -> Distances:
        return self.matrix[a, b]

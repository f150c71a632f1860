import numpy as np
import pytest
from index_entries import MatrixDistance, SyntheticEntries

N, QUERIES = 600, 40


class Spy:
    """A distance that notes every pair it is asked for; the judge of everyone else's counts."""

    def __init__(self, matrix):
        self.matrix = matrix
        self.asked = []

    def __len__(self):
        return self.matrix.shape[1]

    def pairs(self, a, b):
        self.asked.append(np.stack([a, b]))
        return self.matrix[a, b]

    @property
    def count(self):
        return sum(call.shape[1] for call in self.asked)


@pytest.fixture(scope="session")
def tables():
    """Distances (n, n) between made-up entries and (Q, n) from entries that are not among them."""
    entries = SyntheticEntries.draw(N + QUERIES, seed=5)
    return entries.matrix(slice(N), slice(N)), entries.matrix(slice(N, None), slice(N))


@pytest.fixture(scope="session")
def nodes(tables):
    return MatrixDistance(tables[0])


@pytest.fixture(scope="session")
def to(tables):
    return MatrixDistance(tables[1]).pairs


@pytest.fixture
def spy(tables):
    return Spy(tables[0])


@pytest.fixture
def query_spy(tables):
    return Spy(tables[1])

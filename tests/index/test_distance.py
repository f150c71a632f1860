import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from index_entries import MatrixDistance, SyntheticEntries

from dynreg.errors import UsageError
from dynreg.index import Counted

SMALL = SyntheticEntries.draw(12, seed=2).matrix()
PAIRS = st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), min_size=1, max_size=30)


@given(st.lists(PAIRS, min_size=1, max_size=4))
def test_counted_gives_the_distances_and_counts_each_pair_once(calls):
    counted = Counted(MatrixDistance(SMALL))
    seen = set()
    for call in calls:
        a, b = np.array(call).T
        np.testing.assert_allclose(counted.pairs(a, b), SMALL[a, b], rtol=1e-12)
        seen |= {tuple(sorted(pair)) for pair in call}
        assert counted.evaluations == len(seen)


def test_what_is_known_is_not_asked_again(spy):
    counted = Counted(spy)
    first = counted.pairs(np.full(len([1, 2, 5, 2]), 3), np.array([1, 2, 5, 2]))
    again = counted.pairs(np.full(len([5, 1]), 3), np.array([5, 1]))
    assert counted.evaluations == 3 == spy.count and len(spy.asked) == 1
    np.testing.assert_array_equal(again, first[[2, 0]])


@pytest.mark.parametrize("matrix", [np.ones(3), np.array([[1.0, np.nan], [1.0, 1.0]])])
def test_a_matrix_that_is_none_is_refused(matrix):
    with pytest.raises(UsageError):
        MatrixDistance(matrix)


def test_made_up_entries_misbehave_as_the_cross_loss_does():
    entries = SyntheticEntries.draw(300, seed=1)
    matrix = entries.matrix()
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    assert matrix.min() >= 1.0
    assert entries.noise.max() / entries.noise.min() == pytest.approx(10, rel=0.1)
    longer = matrix[:, None, :] > matrix[:, :, None] + matrix[None, :, :]
    assert longer.mean() > 1e-3  # d(a, c) > d(a, b) + d(b, c)

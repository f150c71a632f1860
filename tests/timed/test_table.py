"""The displacement table: what it draws, what its tests reject, and what of the old an update leaves."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.timed.table import DisplacementTable, Rules, rejections, updated

CELLS = 100


def samples(seed: int, each: int = 10, shift: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """`each` samples of every cell, of deviation 1 about the number of the cell, moved by `shift` (cells, 3)."""
    cell = np.repeat(np.arange(CELLS), each)
    middle = np.arange(CELLS)[:, None] + np.broadcast_to(shift, (CELLS, 3))
    return cell, middle[cell] + stream(seed, "samples").standard_normal((len(cell), 3))


@pytest.fixture
def table() -> DisplacementTable:
    return DisplacementTable.of(CELLS, *samples(1))


def test_moments_are_those_of_the_samples(table: DisplacementTable) -> None:
    count, mean, deviation = table.moments()
    own = table.values[table.cell == 7]
    assert (count == 10).all() and np.allclose(mean[7], own.mean(axis=0))
    assert np.allclose(deviation[7], own.std(axis=0, ddof=1))


def test_a_cell_with_one_sample_has_no_deviation_and_one_that_is_not_there_is_refused() -> None:
    lost = DisplacementTable.of(CELLS, np.array([3, 3, 4]), np.zeros((3, 3)))
    assert np.isfinite(lost.moments()[2][3]).all() and np.isnan(lost.moments()[2][4]).all()
    with pytest.raises(UsageError, match="0 to 99"):
        DisplacementTable.of(CELLS, np.array([100]), np.zeros((1, 3)))


@pytest.mark.parametrize("welch", [False, True])
def test_without_a_change_the_tests_keep_their_level(welch: bool, table: DisplacementTable) -> None:
    """300 tests at 5 %: 15 on average, 90 % of the time 9 to 21; with the false-discovery rate kept, hardly any."""
    shares = []
    for seed in range(2, 7):
        new = DisplacementTable.of(CELLS, *samples(seed))
        p, rejected = rejections(table, new, Rules(welch=welch))
        assert np.isfinite(p).all()
        shares.append(rejected.mean())
        assert rejections(table, new, Rules(welch=welch, together=True))[1].sum() <= 3
    assert 0.03 < np.mean(shares) < 0.07


def test_as_printed_new_samples_are_held_against_themselves_too_and_little_is_rejected(
    table: DisplacementTable,
) -> None:
    cell, values = samples(2)
    shares = {
        apart: updated(table, cell, values, 50, Rules(apart=apart))[1].rejected.mean()
        for apart in (True, False)
    }
    assert shares[False] < 0.5 * shares[True]


def test_p_values_are_scipys(table: DisplacementTable) -> None:
    from scipy.stats import ttest_ind

    new = DisplacementTable.of(CELLS, *samples(3, 6, 0.5))
    for welch in (False, True):
        p, _ = rejections(table, new, Rules(welch=welch))
        one = ttest_ind(table.values[table.cell == 9, 2], new.values[new.cell == 9, 2], equal_var=not welch)
        assert p[9, 2] == pytest.approx(one.pvalue)


def test_what_changed_is_found_and_follows(table: DisplacementTable) -> None:
    shift = np.zeros((CELLS, 3))
    shift[:20, 1] = 3.0  # 20 cells move on one axis
    cell, values = samples(4, 10, shift)
    for together in (False, True):
        after, found = updated(table, cell, values, 50, Rules(together=together))
        assert found.tests == 300 and found.rejected[:20, 1].all()
        assert found.rejected[20:].mean() < 0.1 and found.removed[~found.rejected].sum() == 0
        was, now = (np.abs(t.moments()[1][:20, 1] - np.arange(20) - 3.0).mean() for t in (table, after))
        assert now < 0.5 * was
        removed = found.removed[:20, 1]
        assert (removed > 0).all() and (removed <= 5).all()
        assert after.counts.sum() == 6000 - found.removed.sum()
    assert np.allclose((found.new - found.old)[:20, 1], 3.0, atol=1.6)
    kept = (after.cell == 3) & after.counts[:, 1] & (after.born == 0)
    gone = (after.cell == 3) & ~after.counts[:, 1]
    assert after.values[gone, 1].max() <= after.values[kept, 1].min()  # the smallest went first


def test_one_visit_is_no_test_and_other_cells_stay(table: DisplacementTable) -> None:
    after, found = updated(table, np.array([5, 8, 8]), np.full((3, 3), 50.0), 50)
    assert np.isnan(found.p[5]).all() and np.isfinite(found.p[8]).all()
    assert found.tests == 3 and found.rejected[8].all()
    assert (after.moments()[0][5] == 11).all()


def test_old_samples_go_but_the_newest_stay(table: DisplacementTable) -> None:
    cell, values = np.repeat(np.arange(10), 3), samples(5, 3)[1][:30]
    after, found = updated(table, cell, values, 501, Rules(most=0.0))
    assert found.aged == CELLS * 5  # of ten old ones the newest five stay
    assert (after.moments()[0][:10] == 8).all() and (after.moments()[0][10:] == 5).all()
    again, found = updated(after, cell, values + 0.1, 502, Rules(most=0.0))
    assert found.aged == 10 * 3  # three newer ones are among the five
    assert updated(table, cell, values, 500, Rules(most=0.0))[1].aged == 0


def test_where_nothing_scatters_rounding_rejects_nothing() -> None:
    """Logs without noise, or of whole millimetres: a difference of 1e-15 m rejected every test."""
    cell = np.repeat(np.arange(5), 4)
    known = DisplacementTable.of(5, cell, np.tile([0.1, 0.2, 0.3], (20, 1)))
    new = DisplacementTable.of(5, cell, known.values + 1e-15, 1)
    p, rejected = rejections(known, new, Rules())
    assert (p > 0.99).all() and not rejected.any()
    moved = DisplacementTable.of(5, cell, known.values + [0.0, 1e-3, 0.0], 1)
    assert rejections(known, moved, Rules())[1].tolist() == [[False, True, False]] * 5

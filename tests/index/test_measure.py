from functools import partial

import numpy as np
import pytest
from index_measure import (
    METHODS,
    by_graph,
    fit_growth,
    hubness,
    measure_graph,
    nearest_lists,
    quality,
    recall,
)

from dynreg.errors import UsageError
from dynreg.index import Found

TRUTH = np.array([[1.1, 1.2, 1.2, 1.5, 2.0]])


def _found(*ids):
    return [Found(np.array(ids), TRUTH[0, list(ids)], 5)]


@pytest.mark.parametrize(
    "ids, share", [((0, 1), 1.0), ((0, 2), 1.0), ((1, 2), 1.0), ((0, 3), 0.5), ((3, 4), 0.0)]
)
def test_recall_counts_ties_fairly(ids, share):
    assert recall(_found(*ids), TRUTH, 2) == share


def test_a_missing_answer_costs_recall():
    assert recall(_found(0), TRUTH, 2) == 0.5


def test_quality_is_the_share_of_what_brute_force_gains_over_chance():
    """In log d: 1 for the nearest, 0 for what a node at random has, below 0 for what is worse."""
    assert quality(_found(0, 1), TRUTH, 2) == pytest.approx(1.0)
    every, best, worst = (np.log(TRUTH[0, ids]).mean() for ids in ([0, 1, 2, 3, 4], [0, 1], [3, 4]))
    far = quality(_found(3, 4), TRUTH, 2)
    assert far == pytest.approx((every - worst) / (every - best)) and far < 0.0
    half = np.exp(0.5 * (every + best))
    assert quality([Found(np.array([0, 1]), np.full(2, half), 5)], TRUTH, 2) == pytest.approx(0.5)


def test_hubness_of_an_even_ring_and_of_one_hub():
    ring = [np.array([(i + 1) % 50]) for i in range(50)]
    star = [np.array([0]) for _ in range(50)]
    assert hubness(ring, 50).skewness == 0.0 and hubness(ring, 50).never == 0.0
    assert hubness(star, 50).largest == 50 and hubness(star, 50).never == 0.98
    assert hubness(star, 50).skewness == pytest.approx(6.857, abs=1e-3)  # (n - 2) / sqrt(n - 1)


def test_noisy_entries_are_hubs(nodes, tables):
    lists = nearest_lists(nodes, 300, 5)
    assert all(i not in near and len(near) == 5 for i, near in enumerate(lists))
    assert hubness(lists, 300).skewness > 1.0


def test_growth_tells_log_from_linear():
    n = np.array([250, 500, 1000, 2000])
    log, linear = fit_growth(n, 7 + 40 * np.log(n)), fit_growth(n, 7 + 0.2 * n)
    assert log.log_r2 == pytest.approx(1.0) and log.log_slope == pytest.approx(40.0)
    assert log.linear_r2 < 0.95 and log.linear_residual > 1.0 > log.log_residual
    assert linear.linear_r2 == pytest.approx(1.0) and linear.linear_slope == pytest.approx(0.2)
    assert linear.log_r2 < 0.95
    with pytest.raises(UsageError):
        fit_growth([1, 2], [1, 2])


def test_measuring_orders_the_methods_as_they_deserve(tables, to):
    rows = {row.method: row for row in measure_graph(*tables, sizes=[600])}
    assert set(rows) == set(METHODS)
    assert rows["chance"].recall < 0.1 < rows["fingerprints"].recall < rows["landmarks"].recall
    assert rows["printed"].recall < rows["graph"].recall
    assert rows["graph"].recall >= 0.99 and rows["landmarks"].recall >= 0.99
    assert rows["chance"].quality < 0.3 < 0.99 < rows["graph"].quality <= 1.0
    assert rows["landmarks"].evaluations == 178
    assert rows["graph"].evaluations < 240


def test_measuring_takes_tables_and_callables_alike(tables, nodes, to):
    only = {"graph": partial(by_graph, ef=10)}
    by_table = measure_graph(*tables, sizes=[100, 200], methods=only)
    by_call = measure_graph(nodes, to, len(tables[1]), sizes=[100, 200], methods=only)
    assert by_table == by_call and [row.n for row in by_table] == [100, 200]

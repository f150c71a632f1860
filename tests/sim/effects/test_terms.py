"""The effects of many simulators, put together from those of groups of them."""

import numpy as np

from dynreg.sim.effects import Terms, stacked, term


def test_groups_with_effects_of_their_own_become_one_table() -> None:
    payload, lag = term("payload"), term("command_lag[arm]")
    groups = [
        ([2, 0], Terms((payload, lag), (np.array([[1.0], [2.0]]), np.array([[3.0], [4.0]])))),
        ([1], Terms()),
        ([3], Terms((lag,), (np.array([[5.0]]),))),
    ]
    found = stacked(4, groups)
    assert found.terms == (payload, lag)
    assert np.array_equal(found.values[0][:, 0], [2.0, np.nan, 1.0, np.nan], equal_nan=True)
    assert np.array_equal(found.values[1][:, 0], [4.0, np.nan, 3.0, 5.0], equal_nan=True)


def test_simulators_without_effects_have_none() -> None:
    assert stacked(2, [([0, 1], Terms())]) is None

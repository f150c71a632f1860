import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.models.normaliser import Normaliser, fit_normaliser
from dynreg.rng import stream


def rows(count: int = 400) -> tuple[np.ndarray, ...]:
    rng = stream(0, "normaliser")
    states = rng.normal([5, -2, 1e3], [1, 20, 0.1], (count, 3))
    states[:, 2] = 1e3  # never moves
    actions = rng.uniform(-1, 1, (count, 2))
    context = np.full((count, 1), 24.0)
    next_states = states + rng.normal([1e-3, 0, 0], [1e-2, 3, 0], (count, 3))
    return states, actions, context, next_states


def test_fitted_rows_have_mean_zero_and_deviation_one():
    tables = rows()
    normaliser = fit_normaliser(*tables)
    x, y = normaliser.inputs(*tables[:3]), normaliser.targets(tables[0], tables[3])
    assert x.dtype == y.dtype == np.float32
    moving = [0, 1, 3, 4]
    np.testing.assert_allclose(x[:, moving].mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(x[:, moving].std(0), 1, atol=1e-4)
    np.testing.assert_allclose(y[:, :2].std(0), 1, atol=1e-4)


def test_columns_that_never_move_stay_small_also_on_other_rows():
    states, actions, context, next_states = rows()
    normaliser = fit_normaliser(states, actions, context, next_states)
    x = normaliser.inputs(states, actions, context + 0.5)
    assert np.abs(x[:, 2]).max() < 1e-3
    assert np.abs(x[:, 5]).max() < 1
    shaken = next_states + stream(0, "shake").normal(0, 1e-3, next_states.shape)
    assert np.abs(normaliser.targets(states, shaken)[:, 2]).max() < 1


def test_targets_are_undone_by_next_states_on_any_leading_axes():
    states, actions, context, next_states = rows()
    normaliser = fit_normaliser(states, actions, context, next_states)
    shaped = states.reshape(4, 10, 10, 3), next_states.reshape(4, 10, 10, 3)
    back = normaliser.next_states(shaped[0], normaliser.targets(*shaped))
    np.testing.assert_allclose(back, shaped[1], rtol=1e-6, atol=1e-6)
    cubes = normaliser.inputs(shaped[0], actions.reshape(4, 10, 10, 2), context.reshape(4, 10, 10, 1))
    np.testing.assert_array_equal(cubes.reshape(400, 6), normaliser.inputs(states, actions, context))


def test_arrays_make_the_same_normaliser():
    tables = rows()
    normaliser = fit_normaliser(*tables)
    again = Normaliser.from_arrays(normaliser.as_arrays())
    np.testing.assert_array_equal(again.inputs(*tables[:3]), normaliser.inputs(*tables[:3]))
    with pytest.raises(UsageError, match="'delta_std' is missing"):
        Normaliser.from_arrays({k: v for k, v in normaliser.as_arrays().items() if k != "delta_std"})


def test_bad_rows_and_arrays_are_refused():
    states, actions, context, next_states = rows()
    normaliser = fit_normaliser(states, actions, context, next_states)
    with pytest.raises(UsageError, match="not finite"):
        fit_normaliser(states, actions * np.nan, context, next_states)
    with pytest.raises(UsageError, match="2 state columns"):
        normaliser.inputs(states[:, :2], actions, context)
    with pytest.raises(UsageError, match="5 input columns"):
        normaliser.inputs(states, actions, context[:, :0])
    with pytest.raises(UsageError, match="delta_std holds 0"):
        Normaliser(np.zeros(2), np.ones(2), np.zeros(1), np.zeros(1))
    with pytest.raises(UsageError, match="shapes"):
        Normaliser(np.zeros(2), np.ones(3), np.zeros(1), np.ones(1))

import numpy as np
import pytest

from dynreg.distance.cross_loss import CrossLoss
from dynreg.models.losses import losses, predict
from dynreg.models.mlp import initial
from dynreg.rng import stream

MODELS, ROWS = 6, 20


@pytest.fixture(scope="module")
def stack():
    return initial(5, 3, MODELS, seed=1)


@pytest.fixture(scope="module")
def rows():
    rng = stream(0, "rows")
    return rng.normal(size=(MODELS, ROWS, 5)), rng.normal(size=(MODELS, ROWS, 3))


def mse(stack, m, x, y) -> float:
    return float(np.square(predict(stack[m], x)[0] - y).mean())


def test_it_is_the_formula_of_the_paper(stack, rows):
    x, y = rows
    distance = CrossLoss(stack, x, y)
    for a, b in ((0, 1), (4, 2), (5, 0)):
        crossed = mse(stack, a, x[b], y[b]) + mse(stack, b, x[a], y[a])
        own = mse(stack, a, x[a], y[a]) + mse(stack, b, x[b], y[b])
        np.testing.assert_allclose(distance.pairs(np.array([a]), np.array([b])), crossed / own, rtol=1e-5)


def test_an_entry_is_at_distance_one_of_itself_and_the_order_does_not_matter(stack, rows):
    distance = CrossLoss(stack, *rows)
    every = np.arange(MODELS)
    np.testing.assert_allclose(distance.pairs(every, every), 1.0, rtol=1e-6)
    matrix = distance.matrix()
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(distance.pairs(np.full(MODELS, 2), every), matrix[2], rtol=1e-5)


def test_own_losses_from_training_take_the_place_of_measured_ones(stack, rows):
    given = np.linspace(0.5, 2.0, MODELS)
    measured, with_given = CrossLoss(stack, *rows), CrossLoss(stack, *rows, given)
    a, b = np.array([0, 3]), np.array([1, 5])
    rescaled = measured.pairs(a, b) * (measured.own[a] + measured.own[b]) / (given[a] + given[b])
    np.testing.assert_allclose(with_given.pairs(a, b), rescaled, rtol=1e-6)
    assert np.abs(with_given.pairs(a, b) / measured.pairs(a, b) - 1).max() > 0.05


def test_an_entry_whose_own_loss_is_no_number_is_infinitely_far_from_all(stack, rows):
    given = np.array([1.0, np.inf, 1.0, np.nan, 1.0, 1.0])
    distance, lost = CrossLoss(stack, *rows, given), [1, 3]
    to = distance.query(stack[0], rows[0][0], rows[1][0], 1.0)
    for found in (distance.matrix()[0], distance.pairs(np.zeros(MODELS, dtype=int), np.arange(MODELS))):
        assert np.isinf(found[lost]).all() and np.isfinite(np.delete(found, lost)).all()
    assert np.isinf(to(np.arange(MODELS))[lost]).all()


def test_a_query_that_is_an_entry_is_as_far_from_the_others_as_the_entry(stack, rows):
    x, y = rows
    distance = CrossLoss(stack, x, y)
    to = distance.query(stack[3], x[3], y[3], float(losses(stack[3], x[3], y[3])[0]))
    np.testing.assert_allclose(to(np.arange(MODELS)), distance.matrix()[3], rtol=1e-5)
    np.testing.assert_allclose(to(np.array([5, 0])), distance.matrix()[3, [5, 0]], rtol=1e-5)


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_a_model_that_predicts_no_number_is_infinitely_far_and_the_others_are_not(stack, rows, lost):
    x, y = rows
    own = np.where(np.arange(MODELS) == 2, lost, 1.0)
    distance, every = CrossLoss(stack, x, y, own), np.arange(MODELS)
    to = distance.query(stack[3], x[3], y[3], 1.0)
    for found in (distance.pairs(np.zeros(MODELS, int), every), to(every)):
        np.testing.assert_array_equal(np.isinf(found), every == 2)

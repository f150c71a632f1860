import numpy as np
import pytest
from planted_family import family

from dynreg.distance.embedding import Embedding, fit_embedding, principal
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.rng import stream


@pytest.fixture(scope="module")
def models() -> MlpStack:
    return initial(4, 2, 60, seed=5)


@pytest.fixture(scope="module")
def probes() -> np.ndarray:
    return stream(0, "probes").normal(size=(32, 4)).astype(np.float32)


def apart(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


def test_distances_of_vectors_are_distances_of_predictions(models, probes):
    """With as many components as models nothing is lost."""
    embedding = fit_embedding(models, models[[0]], probes, dimensions=60)
    flat = predict(models, probes).reshape(60, -1).astype(float)
    np.testing.assert_allclose(apart(embedding.vectors(models)), apart(flat), rtol=1e-3, atol=1e-4)


def test_a_new_model_is_nearest_to_the_one_that_predicts_like_it(models, probes):
    embedding = fit_embedding(models, models[[0]], probes, dimensions=16)
    biases = (*models.biases[:3], models.biases[3] + 1e-3)
    moved = MlpStack(models.weights, biases)
    nearest = np.linalg.norm(
        embedding.vectors(moved)[:, None] - embedding.vectors(models)[None], axis=-1
    ).argmin(axis=1)
    np.testing.assert_array_equal(nearest, np.arange(60))


def test_a_family_of_one_direction_lies_on_a_line_in_order(probes):
    shifts = np.linspace(0, 1, 12)
    base, entries = family(np.array([1.0, 0.5, -0.3]), shifts)
    vectors = fit_embedding(entries, base, probes, dimensions=3).vectors(entries)
    assert vectors.shape == (12, 1), "directions in which nothing varies are rounding, and left out"
    np.testing.assert_allclose(np.abs(np.corrcoef(vectors[:, 0], shifts)[0, 1]), 1.0, atol=1e-6)


def test_the_sign_of_a_component_is_fixed(models, probes):
    embedding = fit_embedding(models, models[[0]], probes, dimensions=8)
    largest = np.abs(embedding.components).argmax(axis=1)
    assert (embedding.components[np.arange(8), largest] > 0).all()
    # the same entries in another order are the same embedding, signs included
    other = fit_embedding(models[np.arange(60)[::-1]], models[[0]], probes, dimensions=8)
    np.testing.assert_allclose(other.components, embedding.components, atol=1e-3)


def test_it_comes_back_from_its_arrays(models, probes):
    embedding = fit_embedding(models, models[[0]], probes)
    again = Embedding(**embedding.as_arrays())
    np.testing.assert_array_equal(again.vectors(models), embedding.vectors(models))
    assert embedding.vectors(models).shape == (60, 59), "60 points span 59 dimensions"


@pytest.mark.parametrize("points", [40, 41, 90])
def test_the_directions_are_those_of_a_singular_value_decomposition(points):
    """Whether there are fewer points than columns, as many, or more."""
    spread = 0.8 ** np.arange(40)
    cloud = stream(points, "cloud").normal(size=(points, 40)) * spread
    centred = cloud - cloud.mean(axis=0)
    found, right = principal(centred, 12), np.linalg.svd(centred, full_matrices=False)[2][:12]
    np.testing.assert_allclose(np.abs((found * right).sum(axis=1)), 1.0, atol=1e-6)
    np.testing.assert_allclose(found @ found.T, np.eye(12), atol=1e-6)

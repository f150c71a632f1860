"""Embedding of models: what they predict on shared probe states."""

from dataclasses import dataclass

import numpy as np

from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack


@dataclass(frozen=True)
class Embedding:
    """A linear map from predictions on probes to a short vector.

    probes : (N, D) normalised model inputs, shared by a population.
    base : (N S,) the base model's predictions, which are subtracted.
    mean : (N S,) and components (D', N S): principal components of the entries' predictions.
    """

    probes: np.ndarray
    base: np.ndarray
    mean: np.ndarray
    components: np.ndarray

    def vectors(self, stack: MlpStack) -> np.ndarray:
        """(M, D') embedding of models; Euclidean distance compares their predictions."""
        out = np.empty((len(stack), len(self.components)), dtype=np.float64)
        for first in range(0, len(stack), 50):
            part = stack[np.arange(first, min(first + 50, len(stack)))]
            flat = predict(part, self.probes).reshape(len(part), -1) - self.base
            out[first : first + len(part)] = (flat - self.mean) @ self.components.T
        return out

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, for the index cache."""
        return dict(vars(self))


def fit_embedding(stack: MlpStack, base: MlpStack, probes: np.ndarray, dimensions: int = 64) -> Embedding:
    """Principal components of the predictions of M models on probes (N, D); as many as they vary in, at most."""
    reference = predict(base, probes)[0].reshape(-1)
    flat = np.concatenate(
        [
            predict(stack[np.arange(i, min(i + 50, len(stack)))], probes).reshape(-1, reference.size)
            for i in range(0, len(stack), 50)
        ]
    )
    flat = flat - reference
    mean = flat.mean(axis=0)
    components = principal((flat - mean).astype(np.float64), dimensions)
    return Embedding(probes, reference, mean, components.astype(np.float32))


def principal(centred: np.ndarray, dimensions: int) -> np.ndarray:
    """(D', F) directions in which M centred points (M, F) vary most, the most first, at most `dimensions`.

    Of the M by M products of the points and the F by F ones of their columns, the smaller matrix is decomposed: both
    tell the same directions.
    """
    points, columns = centred.shape
    values, vectors = np.linalg.eigh(centred @ centred.T if points <= columns else centred.T @ centred)
    # M centred points span M - 1 dimensions at most; a direction without variance is rounding, blown up
    known = max(1, int((values > 1e-10 * values[-1]).sum()))
    keep = np.argsort(values)[::-1][: min(dimensions, known)]
    if points <= columns:
        scale = np.sqrt(np.maximum(values[keep], 1e-12))
        components = (vectors[:, keep] / scale).T @ centred
    else:
        components = vectors[:, keep].T
    # the sign of an eigenvector is arbitrary: fix it, so that the same entries give the same bytes
    signs = np.sign(components[np.arange(len(keep)), np.abs(components).argmax(axis=1)])
    return components * signs[:, None]

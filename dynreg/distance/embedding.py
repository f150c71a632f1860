"""Embedding of models: what they predict on shared probe states."""

from dataclasses import dataclass

import numpy as np

from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, Models

BATCH = 50  # models at once


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

    def vectors(self, stack: Models) -> np.ndarray:
        """(M, D') embedding of models; Euclidean distance compares their predictions."""
        out = np.empty((len(stack), len(self.components)), dtype=np.float64)
        for first in range(0, len(stack), BATCH):
            flat = predictions(stack, self.probes, first) - self.base
            # one product each: a vector does not depend on which others are computed with it
            for at, one in enumerate(flat - self.mean, start=first):
                out[at] = self.components @ one
        return out

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, for the index cache."""
        return dict(vars(self))


def fit_embedding(stack: Models, base: MlpStack, probes: np.ndarray, dimensions: int = 64) -> Embedding:
    """Principal components of the predictions of M models on probes (N, D); as many as they vary in, at most."""
    reference = predict(base, probes)[0].reshape(-1)
    flat = np.concatenate([predictions(stack, probes, first) for first in range(0, len(stack), BATCH)])
    flat = flat - reference
    mean = flat.mean(axis=0)
    components = principal((flat - mean).astype(np.float64), dimensions)
    return Embedding(probes, reference, mean, components.astype(np.float32))


def predictions(stack: Models, probes: np.ndarray, first: int) -> np.ndarray:
    """(m, N S) of some models from `first` on, on probes (N, D)."""
    part = stack[np.arange(first, min(first + BATCH, len(stack)))]
    return predict(part, probes).reshape(len(part), -1)


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

"""Distance between the embeddings of models: what they predict on shared probe states."""

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.models.mlp import MlpStack


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by the Euclidean distance of their vectors to that of the recording's own model; no model is read."""
    apart = np.linalg.norm(asked.population.vectors[asked.allowed] - asked.vector, axis=1)
    return in_order(asked.allowed, apart, len(asked.allowed))


def to_models(asked: DistanceQuery, stack: MlpStack) -> np.ndarray:
    """(M,) Euclidean distances of other models' vectors to that of the recording's own."""
    return np.linalg.norm(asked.population.embedding.vectors(stack) - asked.vector, axis=1)

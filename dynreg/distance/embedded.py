"""Distance between the embeddings of models: what they predict on shared probe states."""

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked
from dynreg.index import vector_index
from dynreg.models.mlp import MlpStack


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by the Euclidean distance of their vectors to that of the recording's own model."""
    population, allowed = asked.population, asked.allowed
    index = vector_index(population.vectors.shape[1], seed=population.shared.seed)
    index.add(population.vectors[allowed])
    ids, apart = index.nearest(asked.vector[None], len(allowed))
    return Ranked(allowed[ids[0]], apart[0], len(allowed))


def to_models(asked: DistanceQuery, stack: MlpStack) -> np.ndarray:
    """(M,) Euclidean distances of other models' vectors to that of the recording's own."""
    return np.linalg.norm(asked.population.embedding.vectors(stack) - asked.vector, axis=1)

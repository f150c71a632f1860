"""Distance between the embeddings of models: what they predict on shared probe states."""

from dynreg.distance.query import DistanceQuery, Ranked
from dynreg.index import vector_index


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by the Euclidean distance of their vectors to that of the recording's own model."""
    population, allowed = asked.population, asked.allowed
    index = vector_index(population.vectors.shape[1], seed=population.shared.seed)
    index.add(population.vectors[allowed])
    ids, apart = index.nearest(asked.vector[None], len(allowed))
    return Ranked(allowed[ids[0]], apart[0], len(allowed))

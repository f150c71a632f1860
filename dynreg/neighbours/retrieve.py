"""Retrieve: the entries whose dynamics look most like the recording's, and a first guess at its parameters."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked
from dynreg.distance.table import AUTO, DISTANCES, NAMES
from dynreg.errors import UsageError
from dynreg.evidence.lockstep import one_blas_thread

ENOUGH = 50  # entries from which parameters can be read off an embedding


@dataclass(frozen=True)
class Retrieved:
    """Entries in order of the distance that is named.

    guess : (P,) unit parameters that a ridge map reads off the recording's embedding; None without one.
    """

    distance_name: str
    ranked: Ranked
    guess: np.ndarray | None


def retrieve(asked: DistanceQuery, distance: str = AUTO, *, guess: bool = True) -> Retrieved:
    """Rank the entries of a population by their distance to a recording.

    distance : one of the table, or "auto", see `_chosen`. guess : whether to read parameters off the recording's own
    model too, where the distance looks at models.
    Raises UsageError for a distance that there is not, or that this robot or population does not have; LogError for a
    recording without rows to judge.
    """
    if distance not in NAMES:
        raise UsageError(
            f"distance {distance!r}", expected=f"one of {', '.join(NAMES)}", do="choose one of them"
        )
    if distance == AUTO:
        distance, ranked = _chosen(asked)
    elif asked.timed and DISTANCES[distance].models:
        raise UsageError(
            f"distance {distance!r} of {asked.robot.name!r}, whose control is timed",
            expected="'replay'",
            do="leave --distance out: models predict one time step, and the rows of its logs are commands",
        )
    else:
        ranked = DISTANCES[distance].rank(asked)
    return Retrieved(distance, ranked, _guess(asked) if guess and DISTANCES[distance].models else None)


def _chosen(asked: DistanceQuery) -> tuple[str, Ranked]:
    """By replay where control is timed, or states were measured now and then; else one-sided.

    By embedding where no entry predicts better than the base model: then one-step errors say nothing, as on servos
    with unmodelled friction.
    """
    if asked.timed or asked.sparse:
        return "replay", DISTANCES["replay"].rank(asked)
    sided = DISTANCES["one_sided"].rank(asked)
    if sided.distance[0] < 1.0:
        return "one_sided", sided
    ranked = DISTANCES["embedding"].rank(asked)
    return "embedding", replace(ranked, evaluations=ranked.evaluations + sided.evaluations)


@one_blas_thread()
def _guess(asked: DistanceQuery) -> np.ndarray | None:
    """(P,) ridge regression from embeddings to unit parameters, at the recording's embedding."""
    vectors, vector = asked.population.vectors, asked.vector
    if len(vectors) < ENOUGH:
        return None
    from sklearn.linear_model import RidgeCV

    mean, scale = vectors.mean(axis=0), vectors.std(axis=0).max()
    model = RidgeCV(np.logspace(-4, 2, 13)).fit((vectors - mean) / scale, asked.population.unit)
    return np.clip(model.predict(((vector - mean) / scale)[None])[0], 0.0, 1.0)

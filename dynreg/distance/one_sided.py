"""One-sided distance: how badly each entry's model predicts the query, a few steps ahead."""

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import Rows, thin
from dynreg.errors import LogError
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser

BATCH = 50  # models at once
QUERY_ROWS = 200  # sequences of the recording on which every entry's model is judged,
AHEAD = 2  # steps long each


def rank(asked: DistanceQuery, entries: np.ndarray | None = None) -> Ranked:
    """Entries (M',), else all that are allowed, by this distance; raises LogError where there is nothing to judge."""
    population, entries = asked.population, asked.allowed if entries is None else entries
    stack = population.stack if len(entries) == len(population) else population.stack[entries]
    return in_order(entries, to_models(asked, stack), len(entries))


def to_models(asked: DistanceQuery, stack: MlpStack) -> np.ndarray:
    """(M,) distances of models of the population; raises LogError where there is nothing to judge."""
    shared = asked.population.shared
    inputs, targets = _sequences(asked.rows)
    judged = thin(len(inputs), QUERY_ROWS, shared.seed, "query")
    if not len(judged):
        raise LogError(
            "no usable rows",
            expected="rows in which all is measured, and in the next as well",
            do="record longer, or query with --distance replay",
        )
    return one_sided(stack, shared.base, inputs[judged], targets[judged], shared.normaliser)


def one_sided(
    stack: MlpStack, base: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser
) -> np.ndarray:
    """(M,) mean absolute error of every model on the query's sequences, relative to the base model's.

    inputs, targets : (N, H, D), (N, H, S) normalised rows, H of them in a row: the model runs on its own
    predictions under the query's commands, and is judged after the last step. Two steps tell simulators apart
    better than one, because what is noise in a step does not add up as what is wrong does.

    Each channel counts by the base model's error on it, so that a channel nobody can predict does not drown
    the others; absolute errors, so that a few violent rows do not either. 1 = as bad as the base model. No own
    losses enter: they differ tenfold between entries, and a symmetric distance makes hubs of the noisy ones.
    """
    scale = channel_scale(base, inputs, targets, normaliser)
    losses = np.empty(len(stack))
    for first in range(0, len(stack), BATCH):
        part = stack[np.arange(first, min(first + BATCH, len(stack)))]
        error = np.abs(_miss(part, inputs, targets, normaliser))
        losses[first : first + len(part)] = error.mean(axis=1) @ scale
    return losses


def channel_scale(
    base: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser
) -> np.ndarray:
    """(S,) weights that make the base model's mean absolute error 1, channel by channel."""
    error = np.abs(_miss(base, inputs, targets, normaliser)[0]).mean(axis=0)
    return 1.0 / (np.maximum(error, 0.03 * error.mean() + 1e-9) * len(error))


def _miss(stack: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser) -> np.ndarray:
    """(M, N, S) error of the change over all H steps, in units of the spread of one step's."""
    channels = targets.shape[-1]
    spread = normaliser.input_std[:channels]
    total = predict(stack, inputs[:, 0])
    for step in range(1, inputs.shape[1]):
        moved = (total * normaliser.delta_std + step * normaliser.delta_mean) / spread
        rows = np.broadcast_to(inputs[:, step], (len(stack), *inputs[:, step].shape)).copy()
        rows[..., :channels] = inputs[:, 0, :channels] + moved
        total = total + predict(stack, rows.astype(np.float32))
    return total - targets.sum(axis=1)


def _sequences(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Rows in a row: inputs (N, H, D) and targets (N, H, S), H = `AHEAD`, or 1 where the log is too short for it."""
    starts = np.arange(len(rows.inputs) - AHEAD + 1)
    for step in range(AHEAD - 1):
        starts = starts[rows.follows[starts + step]]
    if not len(starts):
        return rows.inputs[:, None], rows.targets[:, None]
    at = starts[:, None] + np.arange(AHEAD)
    return rows.inputs[at], rows.targets[at]

"""One-sided distance: how badly each entry's model predicts the query, a few steps ahead."""

from dataclasses import dataclass

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import Rows, thin
from dynreg.errors import LogError
from dynreg.index import search
from dynreg.models.losses import Predictor
from dynreg.models.mlp import MlpStack, Models
from dynreg.models.normaliser import Normaliser
from dynreg.models.threads import available_threads, single_threaded, worker_pool
from dynreg.rng import stream

BATCH = 50  # models at once
QUERY_ROWS = 200  # sequences of the recording on which every entry's model is judged,
AHEAD = 2  # steps long each
KEPT = 40  # of the nearest found that a walk keeps and expands, at least


def rank(asked: DistanceQuery) -> Ranked:
    """Entries that are allowed by this distance: all, or, of many, those that a walk over the graph finds.

    Raises LogError where there is nothing to judge.
    """
    judge = judge_of(asked)
    if asked.walks:
        found = walked(asked, judge)
        if len(found.order) >= asked.at_least:
            return found
    with single_threaded():  # what is worth more cores asks for them itself
        far = judge(asked.population.stack, asked.allowed)
    return in_order(asked.allowed, far, len(asked.allowed))


def walked(asked: DistanceQuery, judge: "Judge") -> Ranked:
    """The entries that a best-first walk over the graph keeps, nearest first; it starts at random ones."""
    population, threads = asked.population, asked.threads or available_threads()
    kept = min(max(KEPT, asked.wanted, asked.at_least), len(asked.allowed))
    with worker_pool(threads) as pool:

        def to(ids: np.ndarray) -> np.ndarray:
            models = [population.stack[part] for part in np.array_split(ids, min(len(ids), threads))]
            return np.concatenate(list(pool.map(judge.of, models)))

        rng = stream(population.shared.seed, "walk")
        found = search(population.graph, to, kept, rng, ef=kept, among=asked.allowed)
    return Ranked(found.ids, found.distances, found.evaluations)


def to_models(asked: DistanceQuery, stack: MlpStack) -> np.ndarray:
    """(M,) distances of models of the population; raises LogError where there is nothing to judge."""
    return judge_of(asked).of(stack)


@dataclass(frozen=True, eq=False)
class Judge:
    """Judges models by a query's sequences (N, H, D), (N, H, S); scale : (S,) of `channel_scale`."""

    inputs: np.ndarray
    targets: np.ndarray
    scale: np.ndarray
    normaliser: Normaliser

    def __call__(self, models: Models, ids: np.ndarray) -> np.ndarray:
        """(m,) distances of the models `ids`, a few of which are read at a time."""
        parts = [self.of(models[ids[i : i + BATCH]], threads=None) for i in range(0, len(ids), BATCH)]
        return np.concatenate([np.zeros(0), *parts])

    def of(self, stack: MlpStack, threads: int | None = 1) -> np.ndarray:
        """(M,) mean absolute error of every model, each channel by its scale."""
        error = np.abs(_miss(stack, self.inputs, self.targets, self.normaliser, threads))
        return (error.mean(axis=1) * self.scale).sum(axis=1)


def judge_of(asked: DistanceQuery) -> Judge:
    """Judges by some sequences of the recording; raises LogError where it has none."""
    shared = asked.population.shared
    inputs, targets = _sequences(asked.rows)
    judged = thin(len(inputs), QUERY_ROWS, shared.seed, "query")
    if not len(judged):
        raise LogError(
            "no usable rows",
            expected="rows in which all is measured, and in the next as well",
            do="record longer, or query with --distance replay",
        )
    inputs, targets = inputs[judged], targets[judged]
    scale = channel_scale(shared.base, inputs, targets, shared.normaliser)
    return Judge(inputs, targets, scale, shared.normaliser)


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
    return Judge(inputs, targets, scale, normaliser)(stack, np.arange(len(stack)))


def channel_scale(
    base: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser
) -> np.ndarray:
    """(S,) weights that make the base model's mean absolute error 1, channel by channel."""
    error = np.abs(_miss(base, inputs, targets, normaliser)[0]).mean(axis=0)
    return 1.0 / (np.maximum(error, 0.03 * error.mean() + 1e-9) * len(error))


def _miss(
    stack: MlpStack,
    inputs: np.ndarray,
    targets: np.ndarray,
    normaliser: Normaliser,
    threads: int | None = None,
) -> np.ndarray:
    """(M, N, S) error of the change over all H steps, in units of the spread of one step's."""
    channels = targets.shape[-1]
    spread = normaliser.input_std[:channels]
    predict = Predictor(stack, threads=threads)
    total = predict(inputs[:, 0])
    for step in range(1, inputs.shape[1]):
        moved = (total * normaliser.delta_std + step * normaliser.delta_mean) / spread
        rows = np.broadcast_to(inputs[:, step], (len(stack), *inputs[:, step].shape)).copy()
        rows[..., :channels] = inputs[:, 0, :channels] + moved
        total = total + predict(rows.astype(np.float32))
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

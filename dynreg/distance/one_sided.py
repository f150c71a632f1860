"""One-sided distance: how badly each entry's model predicts the query, a few steps ahead."""

from dataclasses import dataclass

import numpy as np

from dynreg.distance.ahead import AT_ONCE, Ahead
from dynreg.distance.foreseen import Effort, linear, seek
from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import Rows, thin
from dynreg.errors import LogError
from dynreg.models.mlp import MlpStack, Models
from dynreg.models.normaliser import Normaliser
from dynreg.models.threads import available_threads, in_threads, single_threaded, worker_pool
from dynreg.rng import stream

BATCH = 6 * AT_ONCE  # models at once where all are judged
QUERY_ROWS = 200  # sequences of the recording on which every entry's model is judged,
AHEAD = 2  # steps long each
FORESEEN = 64  # of these sequences, on which misses are foreseen
FIRST = 32  # random entries that are judged before anything is foreseen
LEAST = 160  # entries that a search judges at least


def effort(entries: int) -> Effort:
    """What a search among so many entries spends.

    By ten quadrupeds that report nothing, among 10,000, three draws each: recall@5 0.99 with 202 judged. With 300 near
    0.95; a walk over the graph 0.92 with 361, 0.97 with 465. Of 22 servos among 30,000: 0.99 with 225, 1.00 with
    325. Of eight of them 0.85 where none is judged beside the best; quadrupeds do not tell the two apart. Between 4,000
    and 30,000 the number is a guess: a power of the entries through both.
    """
    least = round(LEAST * max(entries / 4000, 1.0) ** 0.3)
    return Effort(linear(ridge=1.0), least=least, near=500, beside=0.25)


def rank(asked: DistanceQuery) -> Ranked:
    """Entries that are allowed by this distance: all, or, of many, those that a search for the nearest judges.

    Raises LogError where there is nothing to judge.
    """
    judge = judge_of(asked)
    if asked.searched:
        return sought(asked, judge)
    far = judge(asked.population.stack, asked.allowed, asked.threads)
    return in_order(asked.allowed, far, len(asked.allowed))


def sought(asked: DistanceQuery, judge: "Judge") -> Ranked:
    """The entries that are judged on the way to the nearest, nearest first; see `foreseen.seek`."""
    population, allowed = asked.population, asked.allowed
    some = thin(len(judge.ahead.inputs), FORESEEN, population.shared.seed, "foreseen")
    threads = asked.threads or available_threads()
    with worker_pool(threads) as pool:

        def missed(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            most = AT_ONCE * -(-len(at) // (AT_ONCE * threads))  # whole products, whatever the threads
            parts = [allowed[at[i : i + most]] for i in range(0, len(at), most)]
            found = np.concatenate([*pool.map(lambda part: judge.missed(population.stack[part]), parts)])
            return found[:, some].reshape(len(found), -1), distances(found)

        first = stream(population.shared.seed, "seek").permutation(len(allowed))[:FIRST]
        wanted = max(asked.wanted, asked.at_least)
        found = seek(population.vectors[allowed], missed, wanted, first, effort(len(allowed)))
    return Ranked(allowed[found.order], found.distance, found.evaluations)


def to_models(asked: DistanceQuery, stack: MlpStack) -> np.ndarray:
    """(M,) distances of models of the population; raises LogError where there is nothing to judge."""
    return judge_of(asked).of(stack)


@dataclass(frozen=True, eq=False)
class Judge:
    """Judges models by a query's sequences; scale : (S,) of `channel_scale`."""

    ahead: Ahead
    scale: np.ndarray

    def __call__(self, models: Models, ids: np.ndarray, threads: int = 0) -> np.ndarray:
        """(m,) distances of the models `ids`, a few of which are read at a time."""
        parts = [ids[i : i + BATCH] for i in range(0, len(ids), BATCH)]
        found = in_threads(lambda part: distances(self.missed(models[part])), parts, threads or None)
        return np.concatenate([np.zeros(0), *found])

    def of(self, stack: MlpStack) -> np.ndarray:
        """(M,) mean absolute error of every model, each channel by its scale."""
        with single_threaded():
            return distances(self.missed(stack))

    def missed(self, stack: MlpStack) -> np.ndarray:
        """(M, N, S) errors of every model, each channel by its scale."""
        return self.ahead.missed(stack) * self.scale


def distances(missed: np.ndarray) -> np.ndarray:
    """(M,) of weighted errors (M, N, S); a model is infinitely far whose prediction is no number."""
    found = np.abs(missed).mean(axis=1, dtype=np.float64).sum(axis=1)
    return np.where(np.isnan(found), np.inf, found)


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
    return _judge(shared.base, inputs[judged], targets[judged], shared.normaliser)


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
    return _judge(base, inputs, targets, normaliser)(stack, np.arange(len(stack)))


def channel_scale(
    base: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser
) -> np.ndarray:
    """(S,) weights that make the base model's mean absolute error 1, channel by channel."""
    return _scale(base, Ahead(inputs, targets, normaliser))


def _judge(base: MlpStack, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser) -> Judge:
    ahead = Ahead(inputs, targets, normaliser)
    return Judge(ahead, _scale(base, ahead).astype(np.float32))


def _scale(base: MlpStack, ahead: Ahead) -> np.ndarray:
    with single_threaded():
        error = np.abs(ahead.missed(base)[0]).mean(axis=0, dtype=np.float64)
    return 1.0 / (np.maximum(error, 0.03 * error.mean() + 1e-9) * len(error))


def _sequences(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Rows in a row: inputs (N, H, D) and targets (N, H, S), H = `AHEAD`, or 1 where the log is too short for it."""
    starts = np.arange(len(rows.inputs) - AHEAD + 1)
    for step in range(AHEAD - 1):
        starts = starts[rows.follows[starts + step]]
    if not len(starts):
        return rows.inputs[:, None], rows.targets[:, None]
    at = starts[:, None] + np.arange(AHEAD)
    return rows.inputs[at], rows.targets[at]

"""The base model: one network pooled over many configurations, from which all others start."""

import numpy as np
from numpy import ndarray

from dynreg.models.mlp import HIDDEN, MlpStack, initial
from dynreg.models.rows import checked_rows
from dynreg.models.threads import available_threads, worker_pool
from dynreg.models.train import Passes, Schedule, check_trained, schedule

POOLED = Passes(epochs=12, learning_rate=2e-3, batch_size=256)
SHARDS = 2  # parts of every batch; fixed, so that the sum of their gradients is the same on any machine


def train_base(
    inputs: ndarray,
    targets: ndarray,
    passes: Passes = POOLED,
    *,
    hidden: int = HIDDEN,
    threads: int | None = None,
) -> MlpStack:
    """One network trained on the rows of many configurations; none of them should be an entry's own.

    Warm starts from it are what makes 2 epochs on 800 rows enough. Always on the processor, in float32; the
    same bytes on any number of threads: every batch is cut into the same two parts, added in the same order.

    Parameters
    ----------
    inputs : (N, D) normalised, the rows of all configurations together.
    targets : (N, S) normalised deltas.

    Raises UsageError where shapes do not agree, a number is not finite, or training diverged.
    """
    sizes = (np.shape(inputs)[-1], hidden, hidden, hidden, np.shape(targets)[-1])
    x, y = checked_rows(sizes, inputs, targets)
    plan = schedule(x.shape[1], passes)
    start = initial(sizes[0], sizes[-1], 1, passes.seed, hidden)
    trained = _train_in_shards(start, x, y, plan, min(SHARDS, threads or available_threads()))
    check_trained(trained)
    return trained


def _train_in_shards(
    start: MlpStack, inputs: ndarray, targets: ndarray, plan: Schedule, threads: int
) -> MlpStack:
    import torch

    from dynreg.models.network import Adam, Backprop, Parameters

    net = Parameters(1, start.sizes, "cpu").load(start)
    x, y = torch.tensor(inputs), net.padded(targets)
    adam = Adam(net)
    gradients = [Parameters(1, start.sizes, "cpu") for _ in range(SHARDS)]
    passes: list[dict[int, Backprop]] = [{} for _ in range(SHARDS)]

    def part(shard: int, rows: ndarray, share: float) -> None:
        if len(rows) not in passes[shard]:
            passes[shard][len(rows)] = Backprop(1, len(rows), net)
        index = torch.from_numpy(rows)
        batch = x.index_select(1, index), y.index_select(1, index)
        passes[shard][len(rows)].gradient(net, *batch, share, gradients[shard])

    with worker_pool(threads) as pool:
        for rows, rate in zip(plan.batches, plan.rates, strict=True):
            parts = np.array_split(rows, SHARDS)
            jobs = [pool.submit(part, i, p, len(p) / len(rows)) for i, p in enumerate(parts) if len(p)]
            for job in jobs:
                job.result()
            for other in gradients[1 : len(jobs)]:
                gradients[0].vector.add_(other.vector)
            adam.step(gradients[0], float(rate))
    return net.stack()

"""Training dynamics MLPs by the thousand, a few at a time as batched matrix products (paper D)."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.mlp import MlpStack, stack_of
from dynreg.models.rows import checked_rows
from dynreg.models.threads import in_threads
from dynreg.rng import stream

# Models at once on a GPU, no more and no fewer: kernels are chosen by the number, and with them the last bits.
GPU_CHUNK = 256


@dataclass(frozen=True)
class Passes:
    """How often, how far and in which order a training goes through its rows.

    epochs : times. learning_rate : of the first step; it falls linearly towards 0. batch_size : rows of a step at most.
    """

    epochs: int = 2
    learning_rate: float = 1e-3
    batch_size: int = 40
    seed: int = 0


PASSES = Passes()  # where nobody says; populations and comparisons have their own


@dataclass(frozen=True)
class Schedule:
    """Which rows each step takes and how far it goes, the same for every model of a run.

    Attributes
    ----------
    batches : the row numbers of each step; sizes are at most one apart, so no step is a small rest.
    rates : (T,) learning rates, falling linearly towards 0: most of the worth of longer training, at no cost.
    """

    batches: tuple[ndarray, ...]
    rates: ndarray


def schedule(rows: int, passes: Passes) -> Schedule:
    """Passes over `rows` rows, in a new order each.

    Raises UsageError where there is nothing to do or the learning rate is not positive.
    """
    epochs, batch_size, rate = passes.epochs, passes.batch_size, passes.learning_rate
    if min(rows, epochs, batch_size) < 1 or not 0 < rate < np.inf:
        raise UsageError(
            f"{rows} rows, {epochs} epochs, batch size {batch_size}, learning rate {rate}",
            expected="at least one of each and a positive learning rate",
            do="start from epochs=2, batch_size=40, learning_rate=1e-3",
        )
    steps = -(-rows // batch_size)
    batches = []
    for epoch in range(epochs):
        order = stream(passes.seed, "training", "order", epoch).permutation(rows)
        batches += np.array_split(order, steps)
    return Schedule(tuple(batches), rate * (1 - np.arange(len(batches)) / len(batches)))


def train(
    start: MlpStack,
    inputs: ndarray,
    targets: ndarray,
    passes: Passes = PASSES,
    *,
    chunk: int = 8,
    threads: int | None = None,
    device: str | None = None,
) -> MlpStack:
    """Train M networks with Adam on the mean squared error of the normalised delta.

    All M see their rows in the same order. A model's weights depend on its start, its rows and the
    passes over them; not on `chunk`, on `threads` or on the other models: the same bytes on the same kind
    of processor.

    Parameters
    ----------
    start : M models, or 1 from which all start (the base model).
    inputs : (M, N, D) normalised, or (1, N, D) shared by all models.
    targets : (M, N, S) normalised deltas, or (1, N, S) shared.
    chunk : models trained together on one core; 8 keep weights, gradients and moments in the cache.
    threads : cores, all of them by default.
    device : "cpu", "cuda", ...; by default cuda where torch sees one. There, 256 models train at once; a smaller rest
        is filled up with copies of its last one.

    Raises UsageError where shapes do not agree, a number is not finite, or training diverged.
    """
    x, y = checked_rows(start.sizes, inputs, targets)
    models = max(len(start), len(x), len(y))
    for name, count in (("start", len(start)), ("inputs", len(x)), ("targets", len(y))):
        if count not in (1, models):
            raise UsageError(
                f"{name} for {count} models and others for {models}",
                expected=f"1 or {models}",
                do="give every model its rows, or one set to all",
            )
    plan = schedule(x.shape[1], passes)
    from dynreg.models.network import choose_device

    device = choose_device(device)
    on_cpu = device == "cpu"
    step = max(1, chunk) if on_cpu else GPU_CHUNK

    def train_chunk(first: int) -> MlpStack:
        count = min(step, models - first)
        ids = np.minimum(first + np.arange(count if on_cpu else step), models - 1)
        own = (whole if on_cpu and len(whole) == 1 else whole[ids % len(whole)] for whole in (start, x, y))
        return _train_together(*own, len(ids), plan, device)[:count]

    trained = stack_of(in_threads(train_chunk, range(0, models, step), threads if on_cpu else 1))
    check_trained(trained)
    return trained


def check_trained(trained: MlpStack) -> None:
    """Raises UsageError where a weight is not finite: training ran away."""
    lost = ~np.all([np.isfinite(w).all(axis=(1, 2)) for w in trained.weights], axis=0)
    if lost.any():
        raise UsageError(
            f"training of model {int(np.argmax(lost))} diverged ({int(lost.sum())} of {len(lost)} models)",
            expected="finite weights",
            do="lower the learning rate, or look for outliers in the normalised rows",
        )


def _train_together(
    start: MlpStack, inputs: ndarray, targets: ndarray, models: int, plan: Schedule, device: str
) -> MlpStack:
    """One chunk of M models: start, inputs and targets of 1 or M."""
    import torch

    from dynreg.models.network import Adam, Backprop, Parameters

    net = Parameters(models, start.sizes, device).load(start)
    x, y = torch.tensor(inputs, device=device), net.padded(targets)
    gradient, adam = Parameters(models, start.sizes, device), Adam(net)
    passes = {len(b): Backprop(models, len(b), net) for b in plan.batches}
    for batch, rate in zip(plan.batches, plan.rates, strict=True):
        rows = torch.from_numpy(batch).to(device)
        x_batch, y_batch = (table.index_select(1, rows).expand(models, -1, -1) for table in (x, y))
        passes[len(batch)].gradient(net, x_batch, y_batch, 1.0, gradient)
        adam.step(gradient, float(rate))
    return net.stack()

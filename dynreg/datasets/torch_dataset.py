"""A dataset for torch's DataLoader. Loads torch; import it inside functions only."""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from dynreg.data.transitions import Transitions
from dynreg.models.normaliser import Normaliser
from dynreg.rng import stream_seed


class Batched(Protocol):
    """What batches come from: a `Dataset`, or some of its parts."""

    normaliser: Normaliser | None

    def of_parts(self, numbers: slice) -> "Batched":
        """Only these parts."""

    def batches(self, rows: int, *, seed: int | None) -> Iterator[Transitions]:
        """Transitions, at most `rows` at a time, in the order that a seed draws."""


class Batch(NamedTuple):
    """Transitions as tensors, float32: state (N, S), action (N, A), next_state (N, S), context (N, K).

    entry : (N,) int64, which of `TorchDataset.dataset.entries` each is of. period : (N,) [s] from state to next state.
    """

    state: torch.Tensor
    action: torch.Tensor
    next_state: torch.Tensor
    context: torch.Tensor
    entry: torch.Tensor
    period: torch.Tensor


class TorchDataset(IterableDataset):
    """Batches of transitions, streamed; each worker of a DataLoader takes parts of its own.

    Attributes
    ----------
    dataset : where they come from; `dataset.columns` names what is in them.
    normaliser : of the population, None where there is not one.
    rows : transitions in a batch, at most.
    seed : of the order; None keeps that of the entries.
    epoch : a new one draws a new order; see `set_epoch`.
    """

    def __init__(self, dataset: Batched, rows: int, seed: int | None):
        self.dataset, self.rows, self.seed, self.epoch = dataset, rows, seed, 0
        self.normaliser = dataset.normaliser

    def set_epoch(self, epoch: int) -> None:
        """Draw another order of the same seed from now on, as samplers of torch do; call it before each pass."""
        self.epoch = epoch

    def __iter__(self) -> Iterator[Batch]:
        dataset, worker = self.dataset, get_worker_info()
        if worker is not None:
            dataset = dataset.of_parts(slice(worker.id, None, worker.num_workers))
        seed = (
            self.seed if self.seed is None or not self.epoch else stream_seed(self.seed, "epoch", self.epoch)
        )
        for found in dataset.batches(self.rows, seed=seed):
            names = ("states", "actions", "next_states", "context", "entry", "period")
            yield Batch(*(torch.from_numpy(_own(getattr(found, name))) for name in names))


def _own(array: np.ndarray) -> np.ndarray:
    """The array to write to: a batch is the caller's own, and states that follow each other may share memory."""
    if array.base is not None:
        return array.copy()
    array.setflags(write=True)
    return array

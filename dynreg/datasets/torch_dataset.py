"""A dataset for torch's DataLoader. Loads torch; import it inside functions only."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch.utils.data import IterableDataset, get_worker_info

if TYPE_CHECKING:
    from dynreg.datasets.dataset import Dataset


class Batch(NamedTuple):
    """Transitions as float32 tensors: state (N, S), action (N, A), next_state (N, S), context (N, K)."""

    state: torch.Tensor
    action: torch.Tensor
    next_state: torch.Tensor
    context: torch.Tensor


class TorchDataset(IterableDataset):
    """Batches of transitions, streamed; each worker of a DataLoader takes parts of its own.

    Attributes
    ----------
    dataset : where they come from; `dataset.columns` names what is in them.
    normaliser : of the population, None where there is not one.
    rows : transitions in a batch, at most.
    seed : of the order; None keeps that of the entries. Change it from epoch to epoch.
    """

    def __init__(self, dataset: "Dataset", rows: int, seed: int | None):
        self.dataset, self.rows, self.seed = dataset, rows, seed
        self.normaliser = dataset.normaliser

    def __iter__(self) -> Iterator[Batch]:
        dataset, worker = self.dataset, get_worker_info()
        if worker is not None:
            dataset = replace(dataset, parts=dataset.parts[worker.id :: worker.num_workers])
        for found in dataset.batches(self.rows, seed=self.seed):
            states, actions, after, context = (
                torch.from_numpy(_writable(a))
                for a in (found.states, found.actions, found.next_states, found.context)
            )
            yield Batch(states, actions, after, context)


def _writable(array):  # the batch is the caller's own
    array.setflags(write=True)
    return array

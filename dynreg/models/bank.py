"""Models and data sets held ready, and the losses of any pairs of them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.forward import TILE, Forward, Layers, layers
from dynreg.models.mlp import MlpStack
from dynreg.models.rows import checked_rows
from dynreg.models.threads import available_threads, in_threads

if TYPE_CHECKING:
    import torch

WORTH_A_THREAD = 2048  # rows times models below which starting threads costs more than it saves


class DataSet(NamedTuple):
    """Inputs (N, D) and targets (N, S) of one set, and N."""

    inputs: "torch.Tensor"
    targets: "torch.Tensor"
    rows: int


class Job(NamedTuple):
    """One model and sets to run through it at once; the losses go to `places`."""

    model: int
    sets: list[int]
    places: list[int]
    rows: int


class LossBank:
    """Models and data sets held as tensors, so that asking for losses copies no weights.

    A loss is the mean over rows and channels of the squared error of the normalised delta. The same call
    gives the same bytes on any number of threads. A pair's loss can differ by 1e-6 of itself between calls
    that batch its rows differently (alone, or with other sets of the same model).

    Parameters
    ----------
    stack : M models.
    inputs, targets : B sets, (B, N, D) and (B, N, S), normalised.
    threads : cores, all of them by default.
    device : "cpu" or "cuda"; by default cuda where torch sees one.

    Raises UsageError where shapes do not agree, a number is not finite or an id is out of range.
    """

    def __init__(
        self,
        stack: MlpStack,
        inputs: ndarray,
        targets: ndarray,
        *,
        threads: int | None = None,
        device: str | None = None,
    ):
        from dynreg.models.network import choose_device

        self.sizes = stack.sizes
        self.device = choose_device(device)
        self.threads = (threads or available_threads()) if self.device == "cpu" else 1
        self._models = self._layers(stack)
        self._sets = self._data_sets(inputs, targets)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of models and of sets."""
        return len(self._models), len(self._sets)

    def append(self, stack: MlpStack, inputs: ndarray, targets: ndarray) -> None:
        """Add models and sets at the end: new entries of a population. What is here already is not copied.

        inputs, targets : (B, N, D) and (B, N, S); N may differ from that of the sets already here.
        """
        models, sets = self._layers(stack), self._data_sets(inputs, targets)
        self._models += models
        self._sets += sets

    def pairs(self, model_ids: Sequence[int] | ndarray, set_ids: Sequence[int] | ndarray) -> ndarray:
        """(Q,) float64: the loss of model `model_ids[q]` on set `set_ids[q]`."""
        models = _checked_ids("model", model_ids, len(self._models))
        sets = _checked_ids("set", set_ids, len(self._sets))
        if models.shape != sets.shape:
            raise UsageError(
                f"{len(models)} model ids and {len(sets)} set ids",
                expected="as many of each",
                do="pass pairs",
            )
        return self._run(self._models, self._sets, models, sets)

    def all(self) -> ndarray:
        """(M, B) float64: every model on every set."""
        models, sets = self.shape
        ids = np.repeat(np.arange(models), sets), np.tile(np.arange(sets), models)
        return self._run(self._models, self._sets, *ids).reshape(models, sets)

    def of_set(
        self, inputs: ndarray, targets: ndarray, model_ids: Sequence[int] | ndarray | None = None
    ) -> ndarray:
        """(M,) float64: all models, or the chosen, on one set (N, D), (N, S) from outside (a query)."""
        ids = np.arange(len(self._models)) if model_ids is None else model_ids
        ids = _checked_ids("model", ids, len(self._models))
        sets = self._data_sets(inputs, targets)
        _check_one("set", len(sets))
        return self._run(self._models, sets, ids, np.zeros_like(ids))

    def of_model(self, stack: MlpStack, set_ids: Sequence[int] | ndarray | None = None) -> ndarray:
        """(B,) float64: one model that is not in the bank (a query's) on all sets, or on the chosen."""
        ids = np.arange(len(self._sets)) if set_ids is None else set_ids
        ids = _checked_ids("set", ids, len(self._sets))
        _check_one("model", len(stack))
        return self._run(self._layers(stack), self._sets, np.zeros_like(ids), ids)

    def _layers(self, stack: MlpStack) -> list[Layers]:
        if stack.sizes != self.sizes:
            raise UsageError(
                f"models of sizes {stack.sizes}", expected=f"{self.sizes}", do="keep to one population"
            )
        return layers(stack, self.device)

    def _data_sets(self, inputs: ndarray, targets: ndarray) -> list[DataSet]:
        import torch

        x, y = checked_rows(self.sizes, inputs, targets)
        if len(x) != len(y):
            raise UsageError(
                f"{len(x)} sets of inputs and {len(y)} of targets", expected="as many", do="pass pairs"
            )
        tables = (torch.tensor(table, device=self.device).unbind(0) for table in (x, y))
        return [DataSet(*pair, x.shape[1]) for pair in zip(*tables, strict=True)]

    def _run(
        self, models: list[Layers], sets: list[DataSet], model_ids: ndarray, set_ids: ndarray
    ) -> ndarray:
        """Losses of pairs, their jobs cut into even runs, one for each thread."""
        losses = np.empty(len(model_ids))
        if len(losses) == 0:
            return losses
        jobs = pack(model_ids, set_ids, [s.rows for s in sets])
        rows = np.cumsum([job.rows for job in jobs])
        threads = min(self.threads, len(jobs)) if rows[-1] >= WORTH_A_THREAD else 1
        cuts = np.searchsorted(rows, rows[-1] * np.arange(1, threads) / threads)
        runs = [jobs[a:b] for a, b in zip([0, *cuts], [*cuts, len(jobs)], strict=True)]

        def run(part: list[Job]) -> None:
            forward = Forward(self.sizes, self.device)
            for job in part:
                losses[job.places] = forward.losses(models[job.model], [sets[s] for s in job.sets])

        in_threads(run, runs, threads)
        return losses


def pack(model_ids: ndarray, set_ids: ndarray, rows: list[int]) -> list[Job]:
    """Jobs for the pairs: neighbouring sets of one model together while they fill no more than a tile.

    `rows` are those of every set. Longer products use a core better; longer than a tile leaves its cache.
    """
    jobs: list[Job] = []
    order = np.argsort(model_ids, kind="stable")
    last, filled, sets, places = -1, 0, [], []
    for place, model, one in zip(
        order.tolist(), model_ids[order].tolist(), set_ids[order].tolist(), strict=True
    ):
        if sets and (model != last or filled + rows[one] > TILE):
            jobs.append(Job(last, sets, places, filled))
            sets, places, filled = [], [], 0
        last, filled = model, filled + rows[one]
        sets.append(one)
        places.append(place)
    return [*jobs, Job(last, sets, places, filled)] if sets else jobs


def _check_one(kind: str, count: int) -> None:
    if count != 1:
        raise UsageError(
            f"{count} {kind}s", expected=f"one {kind}", do="ask for each, or append them to the bank"
        )


def _checked_ids(kind: str, ids: Sequence[int] | ndarray, count: int) -> ndarray:
    ids = np.asarray(ids)
    ids = ids.astype(int) if ids.size == 0 else ids
    known = ids.ndim == 1 and ids.dtype.kind in "iu"
    if not known or (ids.size and (ids.min() < 0 or ids.max() >= count)):
        raise UsageError(
            f"{kind} ids {ids!r:.80}", expected=f"a list of numbers from 0 to {count - 1}", do="check the ids"
        )
    return ids

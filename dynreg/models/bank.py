"""Models and data sets held ready, and the losses of any pairs of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.mlp import LAYERS, MlpStack
from dynreg.models.rows import checked_rows
from dynreg.models.threads import available_threads, in_threads

if TYPE_CHECKING:
    import torch

TILE = 256  # rows at once: their activations stay in the cache of one core
WORTH_A_THREAD = 4096  # rows times models below which starting threads costs more than it saves


@dataclass(frozen=True)
class Job:
    """One model and the sets that it is asked about; `places` are where their losses go."""

    model: int
    sets: ndarray
    places: ndarray


class LossBank:
    """Models and data sets held as tensors, so that asking for losses copies nothing.

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
        self._models: list[tuple[torch.Tensor, ...]] = []
        self._sets: list[tuple[torch.Tensor, torch.Tensor]] = []
        self.append_models(stack)
        self.append_sets(inputs, targets)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of models and of sets."""
        return len(self._models), len(self._sets)

    def append_models(self, stack: MlpStack) -> None:
        """Add models at the end; those already here are not copied."""
        self._models += self._model_tensors(stack)

    def append_sets(self, inputs: ndarray, targets: ndarray) -> None:
        """Add sets at the end, (B, N, D) and (B, N, S); N may differ from that of the sets already here."""
        self._sets += self._set_tensors(inputs, targets)

    def append(self, stack: MlpStack, inputs: ndarray, targets: ndarray) -> None:
        """Add models and sets at the end: new entries of a population."""
        models, sets = self._model_tensors(stack), self._set_tensors(inputs, targets)
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
        order = np.argsort(models, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(models[order])) + 1) if len(order) else []
        jobs = [Job(int(models[group[0]]), sets[group], group) for group in groups]
        return self._run(self._models, self._sets, jobs, len(models))

    def all(self) -> ndarray:
        """(M, B) float64: every model on every set."""
        models, sets = self.shape
        every = np.arange(sets)
        jobs = [Job(m, every, m * sets + every) for m in range(models)]
        return self._run(self._models, self._sets, jobs, models * sets).reshape(models, sets)

    def of_set(
        self, inputs: ndarray, targets: ndarray, model_ids: Sequence[int] | ndarray | None = None
    ) -> ndarray:
        """(M,) float64: all models, or the chosen, on one set that is not in the bank (a query)."""
        ids = np.arange(len(self._models)) if model_ids is None else model_ids
        ids = _checked_ids("model", ids, len(self._models))
        jobs = [Job(int(m), np.array([0]), np.array([q])) for q, m in enumerate(ids)]
        return self._run(self._models, self._set_tensors(inputs, targets)[:1], jobs, len(ids))

    def of_model(self, stack: MlpStack, set_ids: Sequence[int] | ndarray | None = None) -> ndarray:
        """(B,) float64: one model that is not in the bank (a query's) on all sets, or on the chosen."""
        ids = np.arange(len(self._sets)) if set_ids is None else set_ids
        ids = _checked_ids("set", ids, len(self._sets))
        jobs = [Job(0, ids, np.arange(len(ids)))] if len(ids) else []
        return self._run(self._model_tensors(stack)[:1], self._sets, jobs, len(ids))

    def _model_tensors(self, stack: MlpStack) -> list[tuple["torch.Tensor", ...]]:
        import torch

        if stack.sizes != self.sizes:
            raise UsageError(
                f"models of sizes {stack.sizes}", expected=f"{self.sizes}", do="keep to one population"
            )
        arrays = [torch.tensor(a, device=self.device).unbind(0) for a in (*stack.weights, *stack.biases)]
        return list(zip(*arrays, strict=True))

    def _set_tensors(self, inputs: ndarray, targets: ndarray) -> list[tuple["torch.Tensor", "torch.Tensor"]]:
        import torch

        x, y = checked_rows(self.sizes, inputs, targets)
        if len(x) != len(y):
            raise UsageError(
                f"{len(x)} sets of inputs and {len(y)} of targets", expected="as many", do="pass pairs"
            )
        tables = (torch.tensor(table, device=self.device).unbind(0) for table in (x, y))
        return list(zip(*tables, strict=True))

    def _run(self, models: list, sets: list, jobs: list[Job], count: int) -> ndarray:
        """Losses of all jobs, in `count` places: jobs are cut into even runs, one for each thread."""
        losses = np.empty(count)
        rows = np.cumsum([sum(len(sets[s][0]) for s in job.sets) for job in jobs]) if jobs else np.zeros(1)
        threads = min(self.threads, len(jobs)) if rows[-1] > WORTH_A_THREAD else 1
        cuts = np.searchsorted(rows, rows[-1] * np.arange(1, threads) / threads)
        runs = [jobs[a:b] for a, b in zip([0, *cuts], [*cuts, len(jobs)], strict=True)]

        def run(part: list[Job]) -> None:
            forward = Forward(self.sizes, self.device)
            for job in part:
                losses[job.places] = forward.losses(models[job.model], [sets[s] for s in job.sets])

        in_threads(run, runs, threads)
        return losses


class Forward:
    """Row errors of one model at a time, tile by tile, in buffers made once."""

    def __init__(self, sizes: tuple[int, ...], device: str):
        import torch

        self.buffers = [torch.empty(TILE, width, device=device) for width in sizes[1:]]

    def losses(
        self, model: tuple["torch.Tensor", ...], sets: list[tuple["torch.Tensor", "torch.Tensor"]]
    ) -> ndarray:
        """(B,) losses of `model` on `sets`."""
        import torch

        x, y = sets[0] if len(sets) == 1 else (torch.cat([s[i] for s in sets]) for i in (0, 1))
        errors = torch.empty(len(x), device=x.device)
        for a in range(0, len(x), TILE):
            tile = slice(a, min(a + TILE, len(x)))
            difference = self.predict(model, x[tile]).sub_(y[tile])
            torch.sum(difference.square_(), 1, out=errors[tile])
        counts = np.array([len(s[0]) for s in sets])
        starts = np.concatenate([[0], np.cumsum(counts[:-1])])
        sums = np.add.reduceat(errors.cpu().numpy(), starts, dtype=np.float64)
        return sums / (counts * y.shape[1])

    def predict(self, model: tuple["torch.Tensor", ...], x: "torch.Tensor") -> "torch.Tensor":
        """(R, S) predictions for R <= 256 rows, in a buffer that the next call writes over."""
        import torch

        h = x
        for i in range(LAYERS):
            h = torch.addmm(model[LAYERS + i], h, model[i], out=self.buffers[i][: len(x)])
            if i < LAYERS - 1:
                h.relu_()
        return h


def _checked_ids(kind: str, ids: Sequence[int] | ndarray, count: int) -> ndarray:
    ids = np.asarray(ids)
    ids = ids.astype(int) if ids.size == 0 else ids
    wrong = (
        ids.ndim != 1
        or ids.dtype.kind not in "iu"
        or (len(ids) > 0 and (ids.min() < 0 or ids.max() >= count))
    )
    if wrong:
        raise UsageError(
            f"{kind} ids {ids!r:.80}", expected=f"a list of numbers from 0 to {count - 1}", do="check the ids"
        )
    return ids

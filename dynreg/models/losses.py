"""Predictions and losses of many models, as plain functions."""

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.bank import WORTH_A_THREAD, LossBank
from dynreg.models.forward import TILE, Forward, layers
from dynreg.models.mlp import MlpStack
from dynreg.models.rows import checked_inputs, checked_rows
from dynreg.models.threads import available_threads, in_threads


class Predictor:
    """Models held ready to predict on several sets of rows, one after the other: their weights are copied once.

    stack : M models. threads : cores, all of them by default. device : "cpu" or "cuda", by default as torch sees one.
    """

    def __init__(self, stack: MlpStack, *, threads: int | None = None, device: str | None = None):
        from dynreg.models.network import choose_device

        self.sizes, self.device = stack.sizes, choose_device(device)
        self.threads = (threads or available_threads()) if self.device == "cpu" else 1
        self._models = layers(stack, self.device)

    def __len__(self) -> int:
        return len(self._models)

    def __call__(self, inputs: ndarray) -> ndarray:
        """(M, N, S) normalised deltas for shared inputs (N, D) or the models' own (M, N, D)."""
        import torch

        x = checked_inputs(self.sizes, inputs)
        _check_sets(len(x), len(self))
        out = np.empty((len(self), x.shape[1], self.sizes[-1]), np.float32)
        sets = torch.tensor(x, device=self.device)

        def run(ids: ndarray) -> None:
            forward = Forward(self.sizes, self.device)
            for m in ids:
                for a in range(0, x.shape[1], TILE):
                    rows = sets[m if len(x) > 1 else 0, a : a + TILE]
                    out[m, a : a + TILE] = forward.predict(self._models[m], rows, len(rows)).cpu().numpy()

        runs = min(self.threads, max(1, len(self) * x.shape[1] // WORTH_A_THREAD))
        in_threads(run, np.array_split(np.arange(len(self)), runs), self.threads)
        return out


def predict(
    stack: MlpStack, inputs: ndarray, *, threads: int | None = None, device: str | None = None
) -> ndarray:
    """(M, N, S) normalised deltas that the models predict for shared inputs (N, D) or their own (M, N, D)."""
    return Predictor(stack, threads=threads, device=device)(inputs)


def losses(stack: MlpStack, inputs: ndarray, targets: ndarray, *, threads: int | None = None) -> ndarray:
    """(M,) loss of every model on shared rows (N, D) or on its own (M, N, D)."""
    x, y = checked_rows(stack.sizes, inputs, targets)
    _check_sets(len(x), len(stack))
    bank = LossBank(stack, x, y, threads=threads)
    return bank.pairs(
        np.arange(len(stack)), np.arange(len(stack)) if len(x) > 1 else np.zeros(len(stack), int)
    )


def _check_sets(sets: int, models: int) -> None:
    if sets not in (1, models):
        raise UsageError(
            f"{sets} sets of rows for {models} models",
            expected=f"1 or {models}",
            do="ask a LossBank for all pairs",
        )

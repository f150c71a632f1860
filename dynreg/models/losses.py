"""Predictions and losses of many models, as plain functions."""

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.bank import WORTH_A_THREAD, LossBank
from dynreg.models.forward import TILE, Forward
from dynreg.models.mlp import MlpStack
from dynreg.models.rows import checked_inputs, checked_rows
from dynreg.models.threads import available_threads, in_threads


def predict(
    stack: MlpStack, inputs: ndarray, *, threads: int | None = None, device: str | None = None
) -> ndarray:
    """(M, N, S) normalised deltas that the models predict for shared inputs (N, D) or their own (M, N, D)."""
    import torch

    from dynreg.models.network import choose_device

    x = checked_inputs(stack.sizes, inputs)
    _check_sets(len(x), len(stack))
    device = choose_device(device)
    out = np.empty((len(stack), x.shape[1], stack.sizes[-1]), np.float32)
    sets = torch.tensor(x, device=device)

    def run(ids: ndarray) -> None:
        forward = Forward(stack.sizes, device)
        for m in ids:
            model = tuple(torch.tensor(a[m], device=device) for a in (*stack.weights, *stack.biases))
            for a in range(0, x.shape[1], TILE):
                rows = sets[m if len(x) > 1 else 0, a : a + TILE]
                out[m, a : a + TILE] = forward.predict(model, rows, len(rows)).cpu().numpy()

    threads = (threads or available_threads()) if device == "cpu" else 1
    parts = np.array_split(
        np.arange(len(stack)), min(threads, max(1, len(stack) * x.shape[1] // WORTH_A_THREAD))
    )
    in_threads(run, parts, threads)
    return out


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

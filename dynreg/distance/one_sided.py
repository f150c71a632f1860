"""One-sided distance: how badly each entry's model predicts the query's rows."""

import numpy as np

from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack


def one_sided(stack: MlpStack, base: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(M,) mean absolute error of every model on the query's rows (N, D), (N, S), relative to the base model's.

    Each channel counts by the base model's error on it, so that a channel nobody can predict does not drown
    the others; absolute errors, so that a few violent rows do not either. 1 = as bad as the base model. No own
    losses enter: they differ tenfold between entries, and a symmetric distance makes hubs of the noisy ones.
    """
    scale = channel_scale(base, inputs, targets)
    losses = np.empty(len(stack))
    for first in range(0, len(stack), 50):
        part = stack[np.arange(first, min(first + 50, len(stack)))]
        error = np.abs(predict(part, inputs) - targets)
        losses[first : first + len(part)] = error.mean(axis=1) @ scale
    return losses


def channel_scale(base: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(S,) weights that make the base model's mean absolute error 1, channel by channel."""
    error = np.abs(predict(base, inputs)[0] - targets).mean(axis=0)
    return 1.0 / (np.maximum(error, 0.03 * error.mean() + 1e-9) * len(error))

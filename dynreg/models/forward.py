"""The forward pass on one core, of one model at a time or of a few: what predictions and losses are made of."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy import ndarray

from dynreg.models.mlp import MlpStack

if TYPE_CHECKING:
    import torch

Layers: TypeAlias = "tuple[torch.Tensor, ...]"  # four weights (in, out), then four biases (out,)
Batch: TypeAlias = (
    "tuple[torch.Tensor, ...]"  # of M models: four weights (M, in, out), then four biases (M, 1, out)
)
TILE = 256  # rows at once: their activations stay in the cache of one core


def layers(stack: MlpStack, device: str) -> list[Layers]:
    """Weights and biases of every model of a stack as tensors."""
    import torch

    arrays = [torch.tensor(a, device=device).unbind(0) for a in (*stack.weights, *stack.biases)]
    return list(zip(*arrays, strict=True))


def batch(stack: MlpStack, device: str) -> Batch:
    """Weights and biases of all models of a stack as tensors."""
    import torch

    weights, biases = (
        [torch.tensor(a, device=device) for a in part] for part in (stack.weights, stack.biases)
    )
    return (*weights, *(b[:, None] for b in biases))


def predicted(models: Batch, x: "torch.Tensor") -> "torch.Tensor":
    """(M, N, S) predictions of models on rows x (M, N, D)."""
    import torch

    *hidden, last = zip(models[:4], models[4:], strict=True)
    for weight, bias in hidden:
        x = torch.baddbmm(bias, x, weight).relu_()
    weight, bias = last
    return torch.baddbmm(bias, x, weight)


class Forward:
    """Predictions and losses in buffers made once. Not for two threads at a time.

    It takes one model after the other: right for many rows of each. For few rows, `predicted` takes several models at
    once, and is quicker.
    """

    def __init__(self, sizes: tuple[int, ...], device: str):
        self.sizes, self.device = sizes, device
        self._buffers: dict[int, list[torch.Tensor]] = {}

    def predict(self, model: Layers, x: "torch.Tensor", rows: int) -> "torch.Tensor":
        """(rows, S) for x (rows, D) of at most a tile, in a buffer that the next call writes over."""
        import torch

        first, second, third, output, _ = self._of(rows)
        w0, w1, w2, w3, b0, b1, b2, b3 = model
        torch.addmm(b0, x, w0, out=first).relu_()
        torch.addmm(b1, first, w1, out=second).relu_()
        torch.addmm(b2, second, w2, out=third).relu_()
        return torch.addmm(b3, third, w3, out=output)

    def losses(
        self, model: Layers, sets: Sequence[tuple["torch.Tensor", "torch.Tensor", int]]
    ) -> ndarray | float:
        """Mean squared errors (B,) of `model` on sets of inputs, targets and rows; a number for one set."""
        import torch

        if len(sets) == 1:
            x, y, rows = sets[0]
            total = 0.0
            for a in range(0, rows, TILE):
                tile = (x, y) if rows <= TILE else (x[a : a + TILE], y[a : a + TILE])
                total += self._errors(model, *tile, min(TILE, rows - a)).sum().item()
            return total / (rows * self.sizes[-1])
        counts = np.array([rows for _, _, rows in sets])
        x, y = torch.cat([s[0] for s in sets]), torch.cat([s[1] for s in sets])
        errors = self._errors(model, x, y, int(counts.sum())).cpu().numpy()
        sums = np.add.reduceat(errors, np.cumsum(counts) - counts, dtype=np.float64)
        return sums / (counts * self.sizes[-1])

    def _errors(self, model: Layers, x: "torch.Tensor", y: "torch.Tensor", rows: int) -> "torch.Tensor":
        """(rows,) squared errors summed over channels."""
        import torch

        difference = self.predict(model, x, rows).sub_(y)
        return torch.sum(difference.square_(), 1, out=self._of(rows)[-1])

    def _of(self, rows: int) -> list["torch.Tensor"]:
        """Outputs of the four layers and row errors for this many rows."""
        if rows not in self._buffers:
            import torch

            widths = self.sizes[1:]
            self._buffers[rows] = [torch.empty(rows, width, device=self.device) for width in widths]
            self._buffers[rows].append(torch.empty(rows, device=self.device))
        return self._buffers[rows]

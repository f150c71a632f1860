"""What models miss that run a few steps ahead on their own predictions, under the commands of a recording."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dynreg.models.forward import Forward, layers
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser

if TYPE_CHECKING:
    import torch


class Ahead:
    """Sequences of normalised rows, inputs (N, H, D) and targets (N, H, S), held ready to judge models.

    A model's misses are the same bytes whatever models are judged with it.
    """

    def __init__(self, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser):
        self.inputs, self.targets, self.normaliser = inputs, targets, normaliser

    def missed(self, stack: MlpStack) -> np.ndarray:
        """(M, N, S) float32 error of the change over all H steps, in units of the spread of one step's."""
        first, *later = self._rows
        change = self._change
        forward = Forward(stack.sizes, first.device.type)
        out = np.empty((len(stack), *self.targets[:, 0].shape), dtype=np.float32)
        for m, model in enumerate(layers(stack, first.device.type)):
            total = forward.predict(model, first, len(first)).clone()
            for step, rows in enumerate(later, start=1):
                moved = self._start + step * self._drift + total * self._gain
                total += forward.predict(model, rows.index_copy(1, self._states, moved), len(rows))
            out[m] = (total - change).cpu().numpy()
        return out

    @cached_property
    def _rows(self) -> "list[torch.Tensor]":
        """H times (N, D): the inputs of each step."""
        return list(self._tensor(self.inputs).unbind(1))

    @cached_property
    def _change(self) -> "torch.Tensor":
        """(N, S) the change over all steps."""
        return self._tensor(self.targets.sum(axis=1))

    @cached_property
    def _start(self) -> "torch.Tensor":
        """(N, S) normalised states at the start."""
        return self._rows[0][:, : self.targets.shape[-1]]

    @cached_property
    def _gain(self) -> "torch.Tensor":
        """(S,) by which a predicted change moves a normalised state."""
        return self._tensor(self.normaliser.delta_std / self._spread)

    @cached_property
    def _drift(self) -> "torch.Tensor":
        """(S,) how far a normalised state moves in each step at a predicted change of nothing."""
        return self._tensor(self.normaliser.delta_mean / self._spread)

    @property
    def _spread(self) -> np.ndarray:
        return self.normaliser.input_std[: self.targets.shape[-1]]

    @cached_property
    def _states(self) -> "torch.Tensor":
        """(S,) the columns of states in a row."""
        import torch

        return torch.arange(self.targets.shape[-1], device=self._rows[0].device)

    def _tensor(self, array: np.ndarray) -> "torch.Tensor":
        import torch

        from dynreg.models.network import choose_device

        return torch.tensor(np.asarray(array, dtype=np.float32), device=choose_device(None))

"""What models miss that run a few steps ahead on their own predictions, under the commands of a recording."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dynreg.models.forward import batch, predicted
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser

if TYPE_CHECKING:
    import torch

# Models in one product. Two threads that begin products of one model wait for one another: of 200 rows a model takes
# 0.41, 0.27, 0.22, 0.21 and 0.18 ms with 1, 2, 4, 8 and 16 at once. With 8, four threads share the 32 of a round.
AT_ONCE = 8


class Ahead:
    """Sequences of normalised rows, inputs (N, H, D) and targets (N, H, S), held ready to judge models.

    The last bits of what a model misses depend on the models in its product. Who judges models in several threads gives
    each of them whole products of `AT_ONCE`, so that their number changes nothing.
    """

    def __init__(self, inputs: np.ndarray, targets: np.ndarray, normaliser: Normaliser):
        self.inputs, self.targets, self.normaliser = inputs, targets, normaliser

    def missed(self, stack: MlpStack) -> np.ndarray:
        """(M, N, S) float32 error of the change over all H steps, in units of the spread of one step's."""
        parts = [stack[i : i + AT_ONCE] for i in range(0, len(stack), AT_ONCE)]
        none = np.empty((0, *self.targets[:, 0].shape), dtype=np.float32)
        return np.concatenate([none, *map(self._missed, parts)])

    def _missed(self, stack: MlpStack) -> np.ndarray:
        first, *later = (rows.expand(len(stack), *rows.shape) for rows in self._rows)
        models = batch(stack, first.device.type)
        total = predicted(models, first)
        for step, rows in enumerate(later, start=1):
            moved = self._start + step * self._drift + total * self._gain
            total += predicted(models, rows.index_copy(2, self._states, moved))
        return (total - self._change).cpu().numpy()

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

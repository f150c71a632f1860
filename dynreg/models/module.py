"""Dynamics models as a torch module, for training and for gradients. Loads torch; import it inside functions only."""

import numpy as np
import torch
from torch import nn

from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser


class DynamicsModule(nn.Module):
    """Next states of M models: 3 hidden layers of 128, ReLU, on normalised rows (paper D); float32.

    `forward(states, actions, context)` takes states (N, S) for all models or (M, N, S), actions (N, A) or (M, N, A) and
    context (K,), (N, K) or (M, N, K), by default the nominal one. It gives (M, N, S); (N, S) where the model was asked
    for alone. The weights are parameters, the normaliser and the nominal context are buffers.
    """

    def __init__(self, stack: MlpStack, normaliser: Normaliser, usual: np.ndarray, alone: bool):
        super().__init__()
        self.alone = alone
        self.weights = nn.ParameterList(torch.tensor(w) for w in stack.weights)
        self.biases = nn.ParameterList(torch.tensor(b)[:, None] for b in stack.biases)
        for name, array in normaliser.as_arrays().items():
            self.register_buffer(name, torch.tensor(array))
        self.register_buffer("usual", torch.tensor(usual, dtype=torch.float32))

    def forward(
        self, states: torch.Tensor, actions: torch.Tensor, context: torch.Tensor | None = None
    ) -> torch.Tensor:
        """The states that follow; see the class."""
        context = self.usual if context is None else context
        shape = torch.broadcast_shapes(states.shape[:-1], actions.shape[:-1], context.shape[:-1])
        rows = torch.cat([part.expand(*shape, part.shape[-1]) for part in (states, actions, context)], dim=-1)
        hidden = ((rows - self.input_mean) / self.input_std).expand(len(self.weights[0]), *rows.shape[-2:])
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            hidden = torch.baddbmm(bias, hidden, weight)
            hidden = hidden.relu() if i + 1 < len(self.weights) else hidden
        after = states + (hidden * self.delta_std + self.delta_mean)
        return after[0] if self.alone else after

"""Dynamics models as a torch module, for training and for gradients. Loads torch; import it inside functions only."""

from typing import TYPE_CHECKING

import torch
from torch import nn

from dynreg.models.normaliser import FIELDS

if TYPE_CHECKING:
    from dynreg.models.dynamics import DynamicsModel


class DynamicsModule(nn.Module):
    """Next states of M models: 3 hidden layers of 128, ReLU, on normalised rows (paper D); float32.

    `forward(states, actions, context)` takes states (N, S) for all models or (M, N, S), actions (N, A) or (M, N, A) and
    context (K,), (N, K) or (M, N, K), by default the nominal one. It gives (M, N, S); (N, S) where the model was asked
    for alone. The weights are parameters, the normaliser and the nominal context are buffers.
    """

    def __init__(self, model: "DynamicsModel"):
        super().__init__()
        self.alone = model.alone
        self.weights = nn.ParameterList(torch.tensor(w) for w in model.stack.weights)
        self.biases = nn.ParameterList(torch.tensor(b)[:, None] for b in model.stack.biases)
        for name in FIELDS:
            self.register_buffer(name, torch.tensor(getattr(model.normaliser, name)))
        self.register_buffer("usual", torch.tensor(model.usual, dtype=torch.float32))

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

"""Forward and backward pass of many MLPs at once, and Adam over all their weights.

Written out rather than left to autograd: every buffer is reused, so a training step allocates little,
and all weights lie in one vector, so Adam is one call. Loads torch; import it inside functions only.

A model's bytes must not depend on its place among others. Products of matrices whose rows are whole vector
registers keep that; narrower ones take paths that depend on alignment (measured: last layers of 1, 3, 5 and
33 columns, and products with a row of ones). So the last layer is padded with columns of zeros, whose
gradient is zero, and biases are summed, not multiplied.
"""

import numpy as np
import torch
from torch.optim.adam import adam

from dynreg.models.mlp import LAYERS, MlpStack

LANES = 8  # floats in a vector register: the last layer's width is a multiple
ALIGN = 16  # floats: every block of weights starts at a multiple, so Adam rounds alike everywhere


class Parameters:
    """The weights of M networks in one vector.

    `weights[i]` (M, in, out) and `biases[i]` (M, 1, out) are views of `vector`; `width` is the padded S.
    """

    def __init__(self, models: int, sizes: tuple[int, ...], device: str):
        self.outputs = sizes[-1]
        self.width = _whole(sizes[-1], LANES)
        self.sizes = (*sizes[:-1], self.width)
        layers = list(zip(self.sizes, self.sizes[1:], strict=False))
        counts = [models * a * b for a, b in layers] + [models * b for _, b in layers]
        starts = np.cumsum([0] + [_whole(count, ALIGN) for count in counts])
        self.vector = torch.zeros(int(starts[-1]), device=device)
        parts = [self.vector[start : start + count] for start, count in zip(starts, counts, strict=False)]
        self.weights = [p.view(models, a, b) for p, (a, b) in zip(parts, layers, strict=False)]
        self.biases = [p.view(models, 1, b) for p, (_, b) in zip(parts[LAYERS:], layers, strict=True)]

    def load(self, stack: MlpStack) -> "Parameters":
        """Set to the weights of `stack`: one model copied to all, or as many as there are here."""
        for own, array in zip(self.weights, stack.weights, strict=True):
            own[:, :, : array.shape[2]] = torch.tensor(array)
        for own, array in zip(self.biases, stack.biases, strict=True):
            own[:, 0, : array.shape[1]] = torch.tensor(array)
        return self

    def stack(self) -> MlpStack:
        """A copy as numpy arrays."""
        weights = [w.cpu().numpy().copy() for w in self.weights]
        biases = [b[:, 0].cpu().numpy().copy() for b in self.biases]
        weights[-1], biases[-1] = weights[-1][..., : self.outputs], biases[-1][..., : self.outputs]
        return MlpStack(tuple(weights), tuple(biases))

    def padded(self, targets: np.ndarray) -> torch.Tensor:
        """(B, N, width) tensor of `targets` (B, N, S), zeros in the columns that were added."""
        table = torch.tensor(targets, device=self.vector.device)
        return torch.nn.functional.pad(table, (0, self.width - self.outputs))


class Backprop:
    """Gradient of the mean squared error over R rows of each of M networks, in buffers made once."""

    def __init__(self, models: int, rows: int, net: Parameters):
        def buffer(width: int) -> torch.Tensor:
            return torch.empty(models, rows, width, device=net.vector.device)

        self.hidden = [buffer(width) for width in net.sizes[1:-1]]
        self.errors = [buffer(width) for width in net.sizes[1:]]

    def gradient(
        self, net: Parameters, x: torch.Tensor, y: torch.Tensor, share: float, out: Parameters
    ) -> None:
        """Write d(share * mean squared error)/d(weights) into `out`, for x (M, R, D), padded y (M, R, S)."""
        below = [x, *self.hidden]
        for i, hidden in enumerate(self.hidden):
            torch.baddbmm(net.biases[i], below[i], net.weights[i], out=hidden).relu_()
        error = torch.baddbmm(net.biases[-1], below[-1], net.weights[-1], out=self.errors[-1])
        error.sub_(y).mul_(2 * share / (y.shape[1] * net.outputs))
        for i in reversed(range(LAYERS)):
            torch.bmm(below[i].transpose(1, 2), error, out=out.weights[i])
            torch.sum(error, 1, keepdim=True, out=out.biases[i])
            if i:
                error = torch.bmm(error, net.weights[i].transpose(1, 2), out=self.errors[i - 1])
                # ReLU passes no gradient where it was off.
                torch.ops.aten.threshold_backward.grad_input(error, below[i], 0, grad_input=error)


class Adam:
    """Adam (Kingma and Ba 2015, algorithm 1), beta 0.9 and 0.999, epsilon 1e-8."""

    def __init__(self, net: Parameters):
        self.net = net
        self.means = torch.zeros_like(net.vector)
        self.squares = torch.zeros_like(net.vector)
        self.steps = torch.zeros((), device=net.vector.device)

    @torch.no_grad()
    def step(self, gradient: Parameters, learning_rate: float) -> None:
        """Move the weights against `gradient`."""
        adam(
            [self.net.vector], [gradient.vector], [self.means], [self.squares], [], [self.steps],
            fused=True, amsgrad=False, maximize=False,
            beta1=0.9, beta2=0.999, lr=learning_rate, weight_decay=0.0, eps=1e-8,
        )  # fmt: skip


def choose_device(device: str | None) -> str:
    """`device`, or cuda where torch sees one, else cpu."""
    return device or ("cuda" if torch.cuda.is_available() else "cpu")


def _whole(count: int, unit: int) -> int:
    return -(-count // unit) * unit

"""Displacements by the MLP of the registry's entries: 3 hidden layers of 128, trained as those are, but from scratch.

How long to train, and from which start, the validation part decides.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.models.train import Passes, train
from dynreg.rng import stream_seed
from dynreg.timed.commands import AXES, Commands
from dynreg.timed.networks import scales

STARTS = 2  # that train side by side
EPOCHS = (30, 100, 300)  # each a training of its own: the learning rate falls to 0 at its end
ROWS = 1000  # with more rows there are fewer epochs: a training takes no more steps
LEARNING_RATE = 2e-3
BATCH = 40


@dataclass(frozen=True, eq=False)
class Mlp:
    """One network 5-128-128-128-3 for standardised inputs and outputs.

    stack : of one model. mean, scale : (5,) of the inputs. out_mean, out_scale : (3,) of the displacements.
    epochs : for which it was trained. error : mean squared validation error, in units of the displacements' variance.
    """

    stack: MlpStack
    mean: np.ndarray
    scale: np.ndarray
    out_mean: np.ndarray
    out_scale: np.ndarray
    epochs: int
    error: float

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""
        inputs = ((commands.table - self.mean) / self.scale).astype(np.float32)
        return self.out_mean + self.out_scale * predict(self.stack, inputs, threads=1, device="cpu")[0]


def train_mlp(
    commands: Commands,
    moved: np.ndarray,
    validation: tuple[Commands, np.ndarray],
    *,
    seed: int = 0,
    threads: int = 0,
) -> Mlp:
    """The network of commands (n,) and displacements (n, 3) with the lowest error on `validation`.

    It depends on `seed` alone, not on `threads` (0 for all cores); always on the processor.
    """
    (mean, scale), (out_mean, out_scale) = scales(commands.table), scales(moved)
    inputs = (commands.table - mean) / scale
    targets = (moved - out_mean) / out_scale
    unseen = ((validation[0].table - mean) / scale).astype(np.float32)
    wanted = (validation[1] - out_mean) / out_scale
    best: tuple[float, int, MlpStack] | None = None
    first = initial(inputs.shape[1], len(AXES), STARTS, stream_seed(seed, "compare", "mlp"))
    for most in EPOCHS:
        epochs = max(1, round(most * min(1.0, ROWS / len(inputs))))
        stack = train(
            first,
            inputs,
            targets,
            Passes(epochs, LEARNING_RATE, BATCH, stream_seed(seed, "compare", "mlp", epochs)),
            chunk=1,
            threads=threads or None,
            device="cpu",
        )
        errors = ((predict(stack, unseen, threads=1, device="cpu") - wanted) ** 2).mean(axis=(1, 2))
        at = int(np.argmin(errors))
        if best is None or errors[at] < best[0]:
            best = (float(errors[at]), epochs, stack[at])
    return Mlp(best[2], mean, scale, out_mean, out_scale, best[1], best[0])

"""Models whose distances are known: the base model with its output shifted along one direction."""

import numpy as np

from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.rng import stream

SHIFTS = np.array([0.9, 0.1, 0.5, 0.0, 0.7, 0.3])  # of the entries; not in order


def family(direction: np.ndarray, shifts: np.ndarray = SHIFTS) -> tuple[MlpStack, MlpStack]:
    """(base, entries): entry m predicts what the base predicts plus `shifts[m]` along `direction` (S,)."""
    base = initial(4, len(direction), 1, seed=3)
    weights = tuple(np.repeat(w, len(shifts), axis=0) for w in base.weights)
    biases = [np.repeat(b, len(shifts), axis=0) for b in base.biases]
    biases[-1] = biases[-1] + shifts[:, None] * direction
    return base, MlpStack(weights, tuple(biases))


def robot_rows(base: MlpStack, direction: np.ndarray, shift: float, rows: int = 80):
    """Inputs and targets of a robot that the entry of this shift predicts without error."""
    x = stream(0, "planted rows").normal(size=(rows, 4))
    return x, predict(base, x)[0] + shift * direction

"""The symmetric cross-loss distance of the paper (D) between entries and of a query to them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.distance.rows import thin
from dynreg.models.bank import LossBank
from dynreg.models.forward import batch, predicted
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack, Models

JUDGED_ON = 64  # held-out rows of each entry on which cross-losses are measured
# The models of the first entries are judged on everybody's rows: by how well these pivots predict them, a search knows
# how hard an entry's rows are for others. With 8 it finds 0.98 of the nearest, with 16 all (`linked.effort`).
PIVOTS = 16
BATCH = 50  # models at once, where all of them are gone through


@dataclass(frozen=True, eq=False)
class Judged:
    """The rows on which entries are judged, inputs (M, N, D) and targets (M, N, S), and losses on them.

    own : (M,) of each entry's model on its rows. crossed : (M, K) of the first K entries' models, the pivots.
    """

    inputs: np.ndarray
    targets: np.ndarray
    own: np.ndarray
    crossed: np.ndarray

    def __len__(self) -> int:
        return len(self.own)

    def as_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, for the index cache."""
        return dict(vars(self))


def judged_on(stack: Models, pivots: MlpStack, inputs: np.ndarray, targets: np.ndarray, seed: int) -> Judged:
    """Up to 64 of the held-out rows (M, N, D), (M, N, S) of entries with models (M), for all the same ones."""
    some = thin(inputs.shape[1], JUDGED_ON, seed, "judged")
    x, y = (np.ascontiguousarray(rows[:, some], dtype=np.float32) for rows in (inputs, targets))
    return Judged(x, y, own_losses(stack, x, y), crossed_losses(pivots, x, y))


def own_losses(stack: Models, inputs: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(M,) the loss of every model on its own rows (M, N, D), (M, N, S)."""
    found = [np.zeros(0)]
    for first in range(0, len(stack), BATCH):
        part = np.arange(first, min(first + BATCH, len(stack)))
        found.append(losses(stack[part], inputs[part], targets[part], threads=1))
    return np.concatenate(found)


def crossed_losses(pivots: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(M, K) float32 losses of K models on each of M sets of rows (M, N, D), (M, N, S)."""
    import torch

    models = batch(pivots, "cpu")

    def on(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        missed = predicted(models, torch.tensor(x).expand(len(pivots), *x.shape)) - torch.tensor(y)
        return missed.square_().mean((1, 2)).numpy()

    found = np.empty((len(inputs), len(pivots)), dtype=np.float32)
    # One set at a time: a loss does not depend on which others are measured with it. It is copied at once, for what is
    # kept of each product would part the memory that the next one needs: 0.4 MB an entry.
    for at, rows in enumerate(zip(inputs, targets, strict=True)):
        found[at] = on(*rows)
    return found


class CrossLoss:
    """d(a, b) = [L_a(D_b) + L_b(D_a)] / [L_a(D_a) + L_b(D_b)] between the entries of one population.

    L_m(D) is the mean squared error of model m's normalised delta on rows of D; d(a, a) = 1, there is no
    triangle inequality, and the floor is about 1. Own losses L_a(D_a) are held-out ones; pass training losses
    to follow the paper's other reading (a weaker distance: it is no better than chance on quadrupeds).
    A call takes out the models and rows that it compares, and no others.

    Parameters
    ----------
    stack : M models.
    inputs, targets : (M, N, D), (M, N, S) the rows each entry is judged on.
    own : (M,) own losses; None measures L_a(D_a) on those rows.
    threads : cores, all of them by default.
    """

    def __init__(
        self,
        stack: Models,
        inputs: np.ndarray,
        targets: np.ndarray,
        own: np.ndarray | None = None,
        *,
        threads: int | None = None,
    ):
        self.stack, self.inputs, self.targets, self.threads = stack, inputs, targets, threads
        self.own = own_losses(stack, inputs, targets) if own is None else np.asarray(own, dtype=float)

    def __len__(self) -> int:
        return len(self.own)

    def pairs(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(Q,) distances of pairs of entries, in one batched call; infinite where a prediction is no number."""
        a, b = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64)
        ids, at = np.unique(np.concatenate([a, b]), return_inverse=True)
        if not len(ids):
            return np.zeros(0)
        found = self._bank(ids).pairs(at, np.concatenate([at[len(a) :], at[: len(a)]]))
        return _far(found[: len(a)] + found[len(a) :], self.own[a] + self.own[b])

    def matrix(self) -> np.ndarray:
        """(M, M) all distances, infinite as in `pairs`: the oracle."""
        found = self._bank(np.arange(len(self))).all()
        return _far(found + found.T, self.own[:, None] + self.own[None, :])

    def query(
        self, model: MlpStack, inputs: np.ndarray, targets: np.ndarray, own: float
    ) -> Callable[[np.ndarray], np.ndarray]:
        """The distances of a recording with its own model (one), rows (N, D), (N, S) and own loss.

        Returns a callable: entry ids (m,) -> (m,) distances, infinite where a prediction is no number.
        """

        def some(ids: np.ndarray) -> np.ndarray:
            bank = self._bank(ids)
            theirs, mine = bank.of_set(inputs, targets), bank.of_model(model)
            return _far(theirs + mine, own + self.own[ids])

        def to(ids: np.ndarray) -> np.ndarray:
            parts = [some(ids[i : i + BATCH]) for i in range(0, len(ids), BATCH)]
            return np.concatenate([np.zeros(0), *parts])

        return to

    def _bank(self, ids: np.ndarray) -> LossBank:
        return LossBank(self.stack[ids], self.inputs[ids], self.targets[ids], threads=self.threads)


def _far(crossed: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Distances of sums of losses, infinite where one is no finite number: a model that diverges is near to nobody."""
    known = np.isfinite(crossed) & np.isfinite(own) & (own > 0.0)
    return np.divide(crossed, own, out=np.full(np.shape(crossed), np.inf), where=known)

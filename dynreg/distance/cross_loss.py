"""The symmetric cross-loss distance of the paper (D) between entries and of a query to them."""

import numpy as np

from dynreg.models.bank import LossBank
from dynreg.models.mlp import MlpStack


class CrossLoss:
    """d(a, b) = [L_a(D_b) + L_b(D_a)] / [L_a(D_a) + L_b(D_b)] between the entries of one population.

    L_m(D) is the mean squared error of model m's normalised delta on rows of D; d(a, a) = 1, there is no
    triangle inequality, and the floor is about 1. Own losses L_a(D_a) are held-out ones; pass training losses
    to follow the paper's other reading (a weaker distance: it is no better than chance on quadrupeds).

    Parameters
    ----------
    stack : M models.
    inputs, targets : (M, N, D), (M, N, S) the rows each entry is judged on.
    own : (M,) own losses; None measures L_a(D_a) on those rows.
    """

    def __init__(
        self,
        stack: MlpStack,
        inputs: np.ndarray,
        targets: np.ndarray,
        own: np.ndarray | None = None,
        *,
        threads: int | None = None,
    ):
        self.bank = LossBank(stack, inputs, targets, threads=threads)
        every = np.arange(len(stack))
        self.own = self.bank.pairs(every, every) if own is None else np.asarray(own, dtype=float)

    def __len__(self) -> int:
        return len(self.own)

    def pairs(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(Q,) distances of pairs of entries, in one batched call."""
        a, b = np.asarray(a), np.asarray(b)
        losses = self.bank.pairs(np.concatenate([a, b]), np.concatenate([b, a]))
        return (losses[: len(a)] + losses[len(a) :]) / (self.own[a] + self.own[b])

    def matrix(self) -> np.ndarray:
        """(M, M) all distances: the oracle."""
        losses = self.bank.all()
        return (losses + losses.T) / (self.own[:, None] + self.own[None, :])

    def query(self, model: MlpStack, inputs: np.ndarray, targets: np.ndarray, own: float):
        """The distances of a recording with its own model (one), rows (N, D), (N, S) and own loss.

        Returns a callable: entry ids (m,) -> (m,) distances.
        """

        def to(ids: np.ndarray) -> np.ndarray:
            theirs = self.bank.of_set(inputs, targets, ids)
            mine = self.bank.of_model(model, ids)
            return (theirs + mine) / (own + self.own[ids])

        return to

"""Trained dynamics models to take out: predictions in physical units, in numpy and in torch."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack
from dynreg.models.normaliser import Normaliser

if TYPE_CHECKING:
    from dynreg.models.module import DynamicsModule


@dataclass(frozen=True, eq=False)
class DynamicsModel:
    """The models of M entries of one population, which share states, actions, context and normaliser.

    Attributes
    ----------
    entries : (M,) their ids. alone : whether one was asked for by itself: predictions then have no axis of models.
    stack : the networks. normaliser : of the population.
    states, actions, context : names of the columns (S,), (A,), (K,).
    usual : (K,) context where none is given: nominal inputs and settings.
    """

    entries: tuple[str, ...]
    alone: bool
    stack: MlpStack
    normaliser: Normaliser
    states: tuple[str, ...]
    actions: tuple[str, ...]
    context: tuple[str, ...]
    usual: ndarray

    def __len__(self) -> int:
        return len(self.stack)

    def __repr__(self) -> str:
        what = self.entries[0][:12] if self.alone else f"{len(self)} entries"
        sizes = f"{len(self.states)} states, {len(self.actions)} actions, {len(self.context)} of context"
        return f"<DynamicsModel of {what}: {sizes}>"

    def predict(
        self,
        states: ndarray,
        actions: ndarray,
        context: ndarray | None = None,
        *,
        steps: int = 1,
        threads: int | None = None,
    ) -> ndarray:
        """The states that follow, float64: (M, N, S), or (M, N, steps, S) over several steps; without M of one alone.

        states : (N, S) for all models, or (M, N, S). actions : (N, A); (N, steps, A) where steps is above 1; for each
        model with M in front. context : (K,), (N, K) or (N, steps, K), by default `usual`. Each model goes on from what
        it predicted. Raises UsageError where shapes do not fit or a number is not finite.
        """
        if steps < 1:
            raise UsageError(f"{steps} steps", expected="at least 1", do="ask for one step or more")
        now = self._rows("states", states, 1, len(self.states))
        told = self._rows("actions", actions, steps, len(self.actions))
        now, out = now[:, :, 0], []
        if now.shape[1] != told.shape[1]:
            raise UsageError(
                f"{now.shape[1]} states and {told.shape[1]} rows of actions",
                expected="as many of each",
                do="give each state its actions",
            )
        about = self._context(context, told.shape[:3])
        for step in range(steps):
            rows = max(len(now), len(told))
            inputs = self.normaliser.inputs(
                np.broadcast_to(now, (rows, *now.shape[1:])),
                np.broadcast_to(told[:, :, step], (rows, *told[:, :, step].shape[1:])),
                np.broadcast_to(about[:, :, step], (rows, *about[:, :, step].shape[1:])),
            )
            delta = predict(self.stack, inputs, threads=threads)
            now = self.normaliser.next_states(np.broadcast_to(now, delta.shape), delta)
            out.append(now)
        found = out[0] if steps == 1 else np.stack(out, axis=2)
        return found[0] if self.alone else found

    def torch(self) -> "DynamicsModule":
        """The same as an `nn.Module` with the normaliser inside; see `DynamicsModule`."""
        from dynreg.models.module import DynamicsModule

        return DynamicsModule(self.stack, self.normaliser, self.usual, self.alone)

    def _rows(self, name: str, values: ndarray, steps: int, width: int) -> ndarray:
        """(1 or M, N, steps, width) of what was given for all models or for each."""
        rows = np.asarray(values, dtype=np.float64)
        rows = rows if name == "actions" and steps > 1 else rows[..., None, :]
        rows = rows[None] if rows.ndim == 3 else rows
        if rows.ndim != 4 or len(rows) not in (1, len(self)) or rows.shape[2:] != (steps, width):
            shape = f"(N, {steps}, {width})" if name == "actions" and steps > 1 else f"(N, {width})"
            raise UsageError(
                f"{name} of shape {np.shape(values)}",
                expected=f"{shape}, or {len(self)} of them, one for each model",
                do=f"give the columns {', '.join(getattr(self, name))}",
            )
        return rows

    def _context(self, values: ndarray | None, shape: tuple[int, ...]) -> ndarray:
        """(1 or M, N, steps, K) context: the same for all rows, for each, or for each step of each."""
        rows = np.asarray(self.usual if values is None else values, dtype=np.float64)
        rows = rows[:, None] if rows.ndim == 2 else rows
        try:
            return np.broadcast_to(rows, (*shape, len(self.context)))
        except ValueError:
            raise UsageError(
                f"context of shape {np.shape(values)}",
                expected=f"(K,), (N, K) or (N, steps, K) with K = {len(self.context)} and N = {shape[1]}",
                do=f"give the columns {', '.join(self.context) or '(none)'}",
            ) from None

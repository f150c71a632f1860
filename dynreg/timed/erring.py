"""A model that errs as it did on a robot's own commands: what a plan is worth that was made in the model."""

from dataclasses import dataclass

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.models import Model, along

NEAR = 10  # commands that are most like another one


@dataclass(frozen=True, eq=False)
class Erring:
    """A model, and how far the robot's displacements (m, 3) of commands (m,) were from its own [m, m, rad].

    Every command errs as one of the ten most like it did, drawn by `rng`, independently of the others: by both wheels'
    speeds and the time, each over its spread. On the way the error grows evenly with time. What the sensors add to
    measured displacements counts as error as well.
    """

    model: Model
    commands: Commands
    off: np.ndarray
    rng: np.random.Generator

    @classmethod
    def of(cls, model: Model, commands: Commands, moved: np.ndarray, rng: np.random.Generator) -> "Erring":
        """From commands (m,) that the model was not fitted to, and the measured displacements (m, 3)."""
        return cls(model, commands, moved - model.predict(commands), rng)

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""
        return self.model.predict(commands) + self._drawn(commands)

    def along(self, commands: Commands, every: float) -> np.ndarray:
        """(n, S, 3) displacements on the way; see `models.along`."""
        out = along(self.model, commands, every)
        after = every * np.arange(1, out.shape[1] + 1)
        share = np.minimum(after / np.maximum(commands.seconds, 1e-9)[:, None], 1.0)
        return out + share[..., None] * self._drawn(commands)[:, None]

    def _drawn(self, commands: Commands) -> np.ndarray:
        """(n, 3) errors."""
        spread = np.maximum(_looks(self.commands).std(axis=0), 1e-9)
        known, asked = _looks(self.commands) / spread, _looks(commands) / spread
        most = min(NEAR, len(known))
        which, back = np.unique(asked, axis=0, return_inverse=True)
        apart = np.linalg.norm(which[:, None] - known, axis=2)
        near = np.argsort(apart, axis=1, kind="stable")[:, :most]
        return self.off[near[back.ravel(), self.rng.integers(most, size=len(commands))]]


def _looks(commands: Commands) -> np.ndarray:
    """(n, 3) by which commands are alike."""
    return np.stack([commands.left, commands.right, commands.seconds], axis=1)

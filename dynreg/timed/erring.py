"""A model that errs as it did on a robot's own commands: what a plan is worth that was made in the model."""

from dataclasses import dataclass

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.models import Model, along


@dataclass(frozen=True, eq=False)
class Erring:
    """A model, and how far the robot was from it after commands in a row, off (m, 3) [m, m, rad].

    Asked are drives of `each` commands, one after the other. A drive errs as the robot did in so many commands in a
    row, from one drawn by `rng` on, after the last again from the first: what one command leaves to the next, such as a
    lag, is made up for there as it was. On the way an error grows evenly with time. What the sensors add to measured
    displacements counts as error as well.
    """

    model: Model
    off: np.ndarray
    each: int
    rng: np.random.Generator

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,), n a multiple of `each`."""
        return self.model.predict(commands) + self._drawn(len(commands))

    def along(self, commands: Commands, every: float) -> np.ndarray:
        """(n, S, 3) displacements on the way; see `models.along`."""
        out = along(self.model, commands, every)
        after = every * np.arange(1, out.shape[1] + 1)
        share = np.minimum(after / np.maximum(commands.seconds, 1e-9)[:, None], 1.0)
        return out + share[..., None] * self._drawn(len(commands))[:, None]

    def _drawn(self, commands: int) -> np.ndarray:
        """(n, 3) errors."""
        if not commands:
            return np.empty((0, 3))
        begin = self.rng.integers(len(self.off), size=commands // self.each)
        return self.off[((begin[:, None] + np.arange(self.each)) % len(self.off)).ravel()]

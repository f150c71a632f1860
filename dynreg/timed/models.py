"""What predicts displacements of timed commands: one interface for the closed form, the unicycle and the networks."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import STEP, unicycle, unicycle_along


class Model(Protocol):
    """Predicts what commands do; `networks.Networks` is one, too."""

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""


@dataclass(frozen=True)
class Kinematic:
    """The closed form, the wheels `track` [m] apart."""

    track: float

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""
        return kinematic(commands, self.track)


@dataclass(frozen=True, eq=False)
class Unicycle:
    """The unicycle with six parameters (6,), the wheels `track` [m] apart."""

    parameters: np.ndarray
    track: float
    step: float = STEP

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""
        return unicycle(commands, self.parameters, self.track, step=self.step)

    def along(self, commands: Commands, every: float) -> np.ndarray:
        """As `along`, in one go: a command's points are on its way."""
        return unicycle_along(commands, self.parameters, self.track, every, step=self.step)


def along(model: Model, commands: Commands, every: float) -> np.ndarray:
    """(n, S, 3) displacements of commands (n,) after `every` [s], twice that, ... and at the end of each; NaN after.

    A model without a way of its own (`along`) is asked for commands that end sooner, as the paper asks its networks.
    """
    if hasattr(model, "along"):
        return model.along(commands, every)
    most = int(np.ceil(commands.seconds.max(initial=0.0) / every - 1e-9))
    ends = np.minimum(every * np.arange(1, most + 1), commands.seconds[:, None])
    there = ends - every * np.arange(most) > 1e-9
    which = np.nonzero(there)[0]
    left, right, _, *before = (column[which] for column in commands.columns)
    out = np.full((*there.shape, 3), np.nan)
    out[there] = model.predict(Commands(left, right, ends[there], *before))
    return out

"""What predicts displacements of timed commands: one interface for the closed form, the unicycle and the networks."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import STEP, unicycle


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

"""What predicts displacements of timed commands: one interface for the closed form, the unicycle and the networks."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import STEP, unicycle, unicycle_along

COARSE = 0.05  # s, the longest step of a search: a choice


class Model(Protocol):
    """Predicts what commands do; `networks.Networks` is one, too."""

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements of commands (n,)."""


@runtime_checkable
class Continuous(Protocol):
    """A model that knows the way between the begin and the end of a command, and tells all of it in one go."""

    def along(self, commands: Commands, every: float) -> np.ndarray:
        """(n, S, 3) displacements; see the function `along`."""


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


def coarse(model: Model) -> Model:
    """What a search asks in its place: the unicycle takes steps of half its shorter lag, of 0.01 to 0.05 s."""
    if not isinstance(model, Unicycle):
        return model
    half = 0.5 * float(model.parameters[:2].min())
    return replace(model, step=min(max(half, model.step), COARSE))


def along(model: Model | Continuous, commands: Commands, every: float) -> np.ndarray:
    """(n, S, 3) displacements of commands (n,) after `every` [s], twice that, ... and at the end of each; NaN after.

    Every command has its end, also one of 0 s. A model that is not `Continuous` is asked for commands that end sooner,
    as the paper asks its networks.
    """
    if isinstance(model, Continuous):
        return model.along(commands, every)
    points = np.maximum(np.ceil(commands.seconds / every - 1e-9).astype(int), 1)
    number = np.arange(points.max(initial=0))
    ends = np.minimum(every * (number + 1), commands.seconds[:, None])
    there = number < points[:, None]
    which = np.nonzero(there)[0]
    left, right, _, *before = (column[which] for column in commands.columns)
    out = np.full((*there.shape, 3), np.nan)
    out[there] = model.predict(Commands(left, right, ends[there], *before))
    return out

"""A model that errs as it did on a robot's own commands: what a plan is worth that was made in the model."""

from dataclasses import dataclass

import numpy as np

from dynreg.rng import stream
from dynreg.timed.commands import Commands
from dynreg.timed.models import Continuous, Model, along


def consecutive(follows: np.ndarray, most: int) -> np.ndarray:
    """(R, r) numbers of r commands each that follow one another: r is `most`, or what the longest run there is has.

    follows : (m,) whether a command begins where the one before it ends (`Told.follows`); m is 1 or more. Runs overlap:
    one ends wherever r commands lie behind it.
    """
    number = np.arange(len(follows))
    first = np.maximum.accumulate(np.where(follows, 0, number))  # of the commands without a gap before each
    behind = number - first + 1
    length = min(most, int(behind.max()))
    return number[behind >= length][:, None] + np.arange(1 - length, 1)


@dataclass(frozen=True, eq=False)
class Erring:
    """A model, and how far the robot was from it after each of m commands, off (m, 3) [m, m, rad].

    Asked are drives of `each` commands, one after the other. A drive errs as the robot did in commands that followed
    each other without a gap, one of the `runs` (R, r) of `consecutive`: what one command leaves to the next, such as a
    lag, is made up for there as it was. Where runs are shorter than a drive, it strings several together. On the way an
    error grows evenly with time. What the sensors add to measured displacements counts as error as well.
    The same seed draws the same errors in every call.
    """

    model: Model | Continuous
    off: np.ndarray
    runs: np.ndarray
    each: int
    seed: int

    def along(self, commands: Commands, every: float) -> np.ndarray:
        """(n, S, 3) displacements on the way of commands (n,), n a multiple of `each`; see `models.along`."""
        out = along(self.model, commands, every)
        after = every * np.arange(1, out.shape[1] + 1)
        share = np.minimum(after / np.maximum(commands.seconds, 1e-9)[:, None], 1.0)
        return out + share[..., None] * self._drawn(len(commands) // self.each)[:, None]

    def _drawn(self, drives: int) -> np.ndarray:
        """(drives * each, 3) errors."""
        many = -(-self.each // self.runs.shape[1])
        chosen = stream(self.seed, "drives").integers(len(self.runs), size=(drives, many))
        rows = self.runs[chosen].reshape(drives, many * self.runs.shape[1])
        return self.off[rows[:, : self.each].ravel()]

"""Data: a recording ready to be replayed, once and for all steps of a query or a calibration."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.cut import windows
from dynreg.replay.known import known_values
from dynreg.replay.parts import Parts, names, parts
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot


@dataclass(frozen=True, eq=False)
class Data:
    """A robot's recording in windows and parts, with what it tells of the parameters before anything is fitted.

    windows : their errors are in units of the windows to fit and to select by; what is held out sets no scale.
    known : (P,) parameters that the recording tells, NaN elsewhere.
    """

    robot: Robot
    recording: Recording
    windows: Windows
    parts: Parts
    known: np.ndarray

    @property
    def start(self) -> np.ndarray:
        """(P,) parameters to start from: what is known, else nominal."""
        return np.where(np.isnan(self.known), self.robot.space.nominal, self.known)

    def with_known(self, unit: np.ndarray) -> np.ndarray:
        """Unit parameters (..., P) with those that are known in their places; beyond [0, 1] where these lie there."""
        return np.where(np.isnan(self.known), unit, self.robot.space.to_unit(self.start))

    def values_of(self, unit: np.ndarray) -> np.ndarray:
        """(..., P) values of unit parameters (..., P) with those that are known, beyond their ranges too."""
        space = self.robot.space
        low, high = space.bounds.T
        clipped = (self.known < low) | (self.known > high)  # by `from_unit`; not where nothing is known
        return np.where(clipped, self.known, space.from_unit(self.with_known(unit)))

    @property
    def named(self) -> dict[str, tuple[str, ...]]:
        """The episodes of each part; see `parts.names`."""
        masks = {"fit": self.parts.fit, "select": self.parts.select, "test": self.parts.test}
        return {part: names(self.recording, self.windows, mask) for part, mask in masks.items()}


def data(robot: Robot, recording: Recording, hold_out: str | None = None) -> Data:
    """A recording cut and parted; hold_out : the test part, see `parts.parts`.

    Raises LogError where it cannot be replayed, UsageError for a test part that cannot be.
    """
    cut = windows(robot, recording)
    split = parts(recording, cut, hold_out)
    scaled = cut.scaled_by(robot, split.chosen)
    return Data(robot, recording, scaled, split, known_values(robot, recording))

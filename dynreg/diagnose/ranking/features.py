"""Features: what a model leaves of a whole log after a calibration of a few rollouts."""

from dataclasses import dataclass

import numpy as np

from dynreg.evidence.data import Data, Sample
from dynreg.evidence.likelihood import information
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, clipped
from dynreg.evidence.slopes import sensitivities

FAR = 4.0  # standard deviations that one step may move a parameter
STEPS = 2  # Gauss-Newton steps
# Of the largest singular value of the derivatives, below which a direction is numerical noise.
SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class Frame:
    """What all features under the commands of one log share.

    sample : the windows to fit and to select by. begun : (W, T, C) residual of the model's start, and slope :
    (D, W, T, C) its derivatives. away : (D', F) orthonormal: what parameters can make up for, F = W T C.
    """

    model: Model
    sample: Sample
    begun: np.ndarray
    slope: np.ndarray
    away: np.ndarray

    @classmethod
    def of(cls, model: Model, data: Data) -> Search["Frame"]:
        """Of a model's start and a log."""
        sample = data.sample(data.both)
        begun, (slope,) = yield from sensitivities(model, [model.start], sample)
        return cls(model, sample, begun[0], slope, _spanned(slope))

    def features(self, measured: np.ndarray) -> Search[np.ndarray]:
        """(n, F) what the model leaves of logs (n, W', T, C) in the sample's windows; 0 where nothing was measured.

        From its start the model's parameters make `STEPS` Gauss-Newton steps with the derivatives of the start; what
        these could still make up for is projected off.
        """
        model, data = self.model, self.sample.data
        # the model's residuals are held against the frame's own log: this turns them to the others
        turn = data.cut((self.sample.measured - measured) / data.spread)
        points, left = [model.start] * len(measured), self.begun + turn
        for _ in range(STEPS):
            points = [self._moved(p, r) for p, r in zip(points, left, strict=True)]
            left = (yield from model.residuals(points, self.sample)) + turn
        flat = _flat(left)
        return flat - (flat @ self.away.T) @ self.away

    @staticmethod
    def left(model: Model, point: Point, data: Data) -> Search[np.ndarray]:
        """(F,) what a point leaves of a log; what its coordinates could make up for to first order is projected off."""
        sample = data.sample(data.both)
        residual, (slope,) = yield from sensitivities(model, [point], sample)
        away, flat = _spanned(slope), _flat(residual)[0]
        return flat - (flat @ away.T) @ away

    def _moved(self, point: Point, residual: np.ndarray) -> Point:
        curvature, downhill = information(point, residual, self.slope, self.sample)
        step = np.linalg.lstsq(curvature, downhill, rcond=1e-12)[0]
        return clipped(self.model.coordinates, point, point.z + np.clip(step, -FAR, FAR))


def _spanned(slope: np.ndarray) -> np.ndarray:
    """(D', F) orthonormal directions that derivatives (D, W, T, C) span."""
    _, sizes, directions = np.linalg.svd(_flat(slope), full_matrices=False)
    return directions[sizes > SMALL * sizes.max(initial=SMALL)]


def _flat(residuals: np.ndarray) -> np.ndarray:
    return np.nan_to_num(residuals).reshape(len(residuals), -1)

"""Points: a hypothesis at coordinates."""

from dataclasses import dataclass

import numpy as np

from dynreg.evidence.hypothesis import Coordinates, Hypothesis, effect_bounds


@dataclass(frozen=True, eq=False)
class Point:
    """One candidate: a hypothesis, its nominal coordinates (P',) and its effect coordinates (K,)."""

    hypothesis: Hypothesis
    nominal: np.ndarray
    effect: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """(P' + K,) all coordinates."""
        return np.concatenate([self.nominal, self.effect])

    def moved(self, z: np.ndarray) -> "Point":
        """The point of the same hypothesis at coordinates z (P' + K,)."""
        return Point(self.hypothesis, z[: len(self.nominal)], z[len(self.nominal) :])

    @property
    def prior(self) -> np.ndarray:
        """(P' + K,) the prior's curvature: 1 for nominal coordinates and shapes, none for sizes."""
        shapes = [float(p.shape) for p in self.hypothesis.parameters]
        return np.concatenate([np.ones(len(self.nominal)), shapes])

    @property
    def penalty(self) -> float:
        """Minus the logarithm of the prior."""
        return 0.5 * float(self.prior @ self.z**2)


def bounds(coordinates: Coordinates, hypothesis: Hypothesis) -> np.ndarray:
    """(P' + K, 2) lowest and highest coordinates."""
    return np.concatenate([coordinates.nominal_bounds, effect_bounds(hypothesis)])


def clipped(coordinates: Coordinates, point: Point, z: np.ndarray) -> Point:
    """The point moved to coordinates z (P' + K,), within their bounds."""
    return point.moved(np.clip(z, *bounds(coordinates, point.hypothesis).T))

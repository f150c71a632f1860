"""A posterior that is about normal: centre, standard deviations and correlations of what is free."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

Stretch = Callable[[np.ndarray], np.ndarray]
SCALES: Mapping[str, tuple[Stretch, Stretch]] = MappingProxyType(
    {
        "linear": (lambda x: x, lambda x: x),
        "log": (np.log, np.exp),
        "inverse": (lambda x: -1.0 / x, lambda x: -1.0 / x),
    }
)
"""{scale: what stretches values so that their posterior is about normal, and the way back}."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """About normal in coordinates that run from 0 to 1 over each range; what lies beyond is clipped to the range.

    Attributes
    ----------
    names : of D quantities: parameters, and sizes of effects as "payload.share".
    scales : (D,) of `SCALES`; limits : (D, 2) values at the coordinates 0 and 1, in each one's unit.
    centre, deviations : (D,) mean and standard deviation, in coordinates. correlations : (D, D).
    untold : names of those of which the recording alone tells nothing.
    """

    names: tuple[str, ...]
    scales: tuple[str, ...]
    limits: np.ndarray
    centre: np.ndarray
    deviations: np.ndarray
    correlations: np.ndarray
    untold: tuple[str, ...] = ()

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """(..., D) coordinates of values (..., D) in their units."""
        return coordinates(self.scales, self.limits, values)

    def values(self, coordinates: np.ndarray) -> np.ndarray:
        """(..., D) values of coordinates (..., D), clipped to the ranges; the inverse of `coordinates`."""
        ways = [SCALES[scale] for scale in self.scales]
        out = np.clip(coordinates, 0.0, 1.0)
        for i, (there, back) in enumerate(ways):
            low, high = there(self.limits[i])
            out[..., i] = np.clip(back(low + out[..., i] * (high - low)), *self.limits[i])
        return out


def coordinates(scales: tuple[str, ...], limits: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(..., D) of values (..., D) with these scales (D,) and limits (D, 2): 0 and 1 at the limits."""
    out = np.array(values, dtype=float)
    for i, scale in enumerate(scales):
        there = SCALES[scale][0]
        low, high = there(limits[i])
        out[..., i] = (there(out[..., i]) - low) / (high - low)
    return out


def correlations_of(covariance: np.ndarray) -> np.ndarray:
    """(D, D) correlation matrix of a covariance (D, D); what does not vary goes with nothing else."""
    size = np.sqrt(np.diag(covariance))
    varies = size > 0
    scale = np.where(varies, size, 1.0)
    found = covariance / np.outer(scale, scale)
    np.fill_diagonal(found, 1.0)
    return np.clip(found, -1.0, 1.0)

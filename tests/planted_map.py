"""A map from four parameters to residuals whose best parameters are known."""

import numpy as np

from dynreg.neighbours.synthesise import Replays, replays_of
from dynreg.rng import stream
from dynreg.sim.space import Parameter, ParameterSpace

NAMES = ("a", "b", "c", "d")
TRUTH = np.array([0.3, 0.8, 0.55, 0.4])
ROWS, WINDOWS = 150, 4


def space() -> ParameterSpace:
    return ParameterSpace(tuple(Parameter(n, "1", 5.0, 0.0, 10.0, "linear", np.inf, ()) for n in NAMES))


class Plant:
    """Residuals of a map from parameters (n, 4): linear, or bent by `curvature`; with `twins`, d shows only as c + d.

    Beside white noise, each window may have a slow disturbance of its own, of standard deviation `drift`.
    """

    def __init__(
        self,
        curvature: float = 0.0,
        noise: float = 0.01,
        twins: bool = False,
        seed: int = 0,
        drift: float = 0.0,
    ):
        rng = stream(seed, "plant")
        self.slopes = rng.normal(size=(4, WINDOWS, ROWS, 1))
        if twins:
            self.slopes[3] = self.slopes[2]
        self.curvature = curvature
        self.noise = noise * rng.normal(size=(WINDOWS, ROWS, 1))
        self.noise += drift * rng.normal(size=(WINDOWS, 1, 1))

    def residuals(self, unit: np.ndarray) -> np.ndarray:
        away = unit - TRUTH
        bent = away + self.curvature * away**2
        return np.tensordot(bent, self.slopes, axes=1) + self.noise


def started(space: ParameterSpace, plant: Plant, free=(True,) * 4, count: int = 18) -> Replays:
    unit = stream(1, "start").uniform(size=(count, 4))
    unit = np.where(free, unit, TRUTH)
    return replays_of(space, np.array(free), np.arange(WINDOWS) < 3, unit, plant.residuals(unit))

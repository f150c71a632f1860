"""The bootstrap over a table's evolutions."""

import numpy as np

from dynreg.evidence.interval import NINETY
from dynreg.rng import stream

DRAWS = 4000


def interval(values: np.ndarray) -> list[float]:
    """The mean of values (n,), and the two ends of where it lies with 90 %."""
    drawn = stream(0, "bootstrap").integers(len(values), size=(DRAWS, len(values)))
    return [float(values.mean()), *map(float, np.quantile(values[drawn].mean(axis=1), NINETY))]


def median_interval(values: np.ndarray) -> list[float]:
    """The two ends of where the median of values (n,) lies with 90 %."""
    drawn = stream(0, "bootstrap").integers(len(values), size=(DRAWS, len(values)))
    return [float(x) for x in np.quantile(np.median(values[drawn], axis=1), NINETY)]

"""Posteriors as parts of results, and back."""

import numpy as np

from dynreg.evidence.gaussian import Gaussian
from dynreg.results.posterior import Posterior


def posterior_told(found: Gaussian) -> Posterior:
    """A posterior as a result tells it."""
    told = {name: value.tolist() for name, value in vars(found).items() if isinstance(value, np.ndarray)}
    return Posterior(**vars(found) | told)


def posterior_of(told: Posterior) -> Gaussian:
    """The posterior that a result tells."""
    arrays = ("limits", "centre", "deviations", "correlations")
    own = {name: np.array(getattr(told, name), dtype=float) for name in arrays}
    own["limits"], own["correlations"] = own["limits"].reshape(-1, 2), _square(own["correlations"])
    return Gaussian(told.names, told.scales, **own, untold=told.untold)


def _square(matrix: np.ndarray) -> np.ndarray:
    return matrix.reshape(len(matrix), len(matrix))

"""How far scores in a simulator are from those on the robot: three ways to say it."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np


def absolute(simulated: np.ndarray, real: np.ndarray) -> np.ndarray:
    """(s,) mean |f_s - f_r|: what paper B's text and Figure 2 say."""
    return np.abs(simulated - real).mean(axis=1)


def signed(simulated: np.ndarray, real: np.ndarray) -> np.ndarray:
    """(s,) mean f_s - f_r: paper B's equation 1 as printed.

    Terms of both signs cancel, and it has no least value: a simulator in which nothing moves is the best. It is here
    to be compared with.
    """
    return (simulated - real).mean(axis=1)


def unranked(simulated: np.ndarray, real: np.ndarray) -> np.ndarray:
    """(s,) 1 - Spearman's correlation of f_s and f_r; 1 where all scores of either are equal."""
    return 1.0 - rank_correlation(simulated, real)


def rank_correlation(simulated: np.ndarray, real: np.ndarray) -> np.ndarray:
    """(s,) Spearman's, of scores (s, m) and (m,): the correlation of their ranks; 0 where all of either are equal."""
    from scipy.stats import rankdata  # takes long to load, and the words of a result need only a unit

    a, b = (rankdata(x, axis=-1) for x in (simulated, real))
    a, b = a - a.mean(axis=-1, keepdims=True), b - b.mean(axis=-1, keepdims=True)
    size = np.sqrt((a**2).sum(axis=-1) * (b**2).sum(axis=-1))
    return np.where(size > 0.0, (a * b).sum(axis=-1) / np.where(size > 0.0, size, 1.0), 0.0)


DIFFERENCES: Mapping[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = MappingProxyType(
    {"absolute": absolute, "signed": signed, "rank": unranked}
)


def unit_of(difference: str, unit: str) -> str:
    """The unit of a difference, by its name, of scores in `unit`; "" for none.

    >>> unit_of("absolute", "m"), unit_of("rank", "m")
    ('m', '')
    """
    return "" if difference == "rank" else unit

"""What gaits will do on a robot that has had trials of some of them."""

from dataclasses import dataclass

import numpy as np

from dynreg.gait.had import Had
from dynreg.gait.near import MORE_FALLS
from dynreg.gait.seek import COMPARED, EXPECTED
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import Trials

ROUNDING = 1e-6  # of the largest variance: what is less tells nothing


@dataclass(frozen=True, eq=False)
class Forecast:
    """Of n gaits. values (n,) : the fitness to expect on the robot. falls (n,) : share of simulated runs that fell."""

    values: np.ndarray
    falls: np.ndarray


def forecast(trials: Trials, had: Had, doubt: float, *new: np.ndarray) -> Forecast:
    """What the gaits that the robot has had will do there on average, and then `new` ones (G,).

    One trial is luck, too: motor noise alone decides whether some gaits fall. The simulators tell what to expect before
    any trial, how much of a trial is noise, and how alike they are wrong about these gaits. With all taken as Gaussian,
    the values are the mean given the trials (Rasmussen and Williams 2006, eq. A.6).

    doubt : of the ranges, 1 sigma, by which the simulators' parameters move.
    """
    genes, m = np.array([*had.genes, *new]), len(had.genes)
    draws = max(-(-EXPECTED // len(trials.simulators)), 2)  # of one draw the noise is not known
    moved = trials.again(genes, draws, first=COMPARED, doubt=doubt)
    still = fitness(trials.again(genes, draws, first=COMPARED))
    luck = (still - still.mean(axis=1, keepdims=True)).reshape(len(genes), -1)
    noise = luck @ luck.T / (still.shape[2] * (draws - 1))
    seen = fitness(moved).reshape(len(genes), -1)
    means, shared = seen.mean(axis=1), _semidefinite(np.atleast_2d(np.cov(seen)) - noise)
    scatter = shared[:m, :m] + np.diag(np.diag(noise)[:m])
    told = np.linalg.lstsq(scatter, np.array(had.reached) - means[:m], rcond=ROUNDING)[0]
    return Forecast(means + shared[:, :m] @ told, fell(moved).mean(axis=(1, 2)))


def best_first(trials: Trials, had: Had, doubt: float) -> Had:
    """The gaits that the robot has had: those that stood before those that fell, then what should do more first."""
    if len(had.genes) < 2:
        return had
    return had.ordered(np.lexsort((-forecast(trials, had, doubt).values, had.fell)))


def new_does_more(trials: Trials, had: Had, doubt: float, near: np.ndarray, new: np.ndarray) -> bool:
    """Whether a new gait (G,) will do more on the robot than one near the first of those that it has had.

    A new one that falls more often in the simulators than both others, by more than `MORE_FALLS`, is not tried, nor one
    that the robot has had. doubt : see `forecast`.
    """
    if np.isclose(np.array(had.genes), new).all(axis=1).any():
        return False
    told = forecast(trials, had, doubt, near, new)
    *_, near_falls, new_falls = told.falls
    if new_falls > max(told.falls[0], near_falls) + MORE_FALLS:
        return False
    return bool(told.values[-1] > told.values[-2])


def _semidefinite(matrix: np.ndarray) -> np.ndarray:
    """The nearest covariance: the difference of two that are estimated may be none."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T

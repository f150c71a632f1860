"""What gaits will do on a robot that has had trials of some of them."""

from dataclasses import dataclass

import numpy as np

from dynreg.gait.had import Had
from dynreg.gait.near import MORE_FALLS
from dynreg.gait.seek import EXPECTED, UNSEEN, expected
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import Trials

COMPARED = 2 * UNSEEN  # draws that no search has seen, nor what is told of its gait
SECOND = COMPARED + EXPECTED  # draws of the same runs once more
# Of the ranges, 1 sigma, by which the simulators' parameters move. On 18 quadrupeds of the development with three
# trials each, the forecast erred by 0.43 m, and by 0.40 m with twice this doubt. A single trial erred by 0.65 m.
DOUBT = 0.05
# Of their scatter (of the task's `success` where that is more), by which simulators are at least wrong about each gait
# alone. So a trial counts even where they agree. On the same quadrupeds the error is 0.42 m with 0, 0.44 m with 0.3.
ALONE = 0.1


@dataclass(frozen=True, eq=False)
class Forecast:
    """Of n gaits. values (n,) : the fitness to expect on the robot. falls (n,) : share of simulated runs that fell."""

    values: np.ndarray
    falls: np.ndarray


def forecast(trials: Trials, had: Had, *new: np.ndarray) -> Forecast:
    """What the gaits that the robot has had will do there on average, and then `new` ones (G,), in this order.

    One trial is luck, too: motor noise alone decides whether some gaits fall. The simulators tell what to expect before
    any trial, how much of a trial is noise, and how alike they are wrong about these gaits. With all taken as Gaussian,
    the values are the conditional mean, given the trials (Rasmussen and Williams 2006, eq. A.6).
    """
    genes, n, m = np.array([*had.genes, *new]), len(had.genes) + len(new), len(had.genes)
    # twice in the same simulators, so that what differs is motor noise
    seen = np.stack([expected(trials, genes, DOUBT, first=at, moved=COMPARED) for at in (COMPARED, SECOND)])
    first, second = fitness(seen)
    means, noise = fitness(seen).mean(axis=(0, 2)), ((first - second) ** 2).mean(axis=1) / 2
    shared = _covariance(np.cov(first, second)[:n, n:])
    alone = ALONE * max(np.sqrt(np.diag(shared).max()), trials.task.success)
    same = (genes[:, None] == genes).all(axis=2)  # two trials of a gait are not two gaits
    shared = shared + alone**2 * same
    scatter = shared[:m, :m] + np.diag(noise[:m])
    apart = np.linalg.lstsq(scatter, np.array(had.reached) - means[:m])[0]
    values = means + shared[:, :m] @ apart
    return Forecast(values, fell(seen).mean(axis=(0, 2)))


def best_first(trials: Trials, had: Had) -> Had:
    """The gaits that the robot has had: those that walked before others, and of each the highest forecast first."""
    if len(had.genes) < 2:
        return had
    return had.ordered(np.lexsort((-forecast(trials, had).values, np.logical_not(had.walked))))


def new_does_more(trials: Trials, had: Had, near: np.ndarray, new: np.ndarray) -> bool:
    """Whether a new gait (G,) will do more on the robot than one near the first of those that it has had.

    A new one that falls in the simulators more often than these two, by more than `MORE_FALLS`, is not tried, nor one
    that the robot has had.
    """
    if np.isclose(np.array(had.genes), new).all(axis=1).any():
        return False
    told = forecast(trials, had, near, new)
    *_, near_falls, new_falls = told.falls
    if new_falls > max(told.falls[0], near_falls) + MORE_FALLS:
        return False
    return bool(told.values[-1] > told.values[-2])


def _covariance(matrix: np.ndarray) -> np.ndarray:
    """The nearest covariance of an estimate, which may be none."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T

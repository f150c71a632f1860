"""What gaits will do on a robot on which another one has walked."""

import numpy as np

from dynreg.gait.near import DOUBT, MORE_FALLS
from dynreg.gait.seek import COMPARED, expected
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import Trials


def new_does_more(trials: Trials, had: np.ndarray, reached: float, near: np.ndarray, new: np.ndarray) -> bool:
    """Whether a new gait (G,) will do more on the robot, on average, than one near the first of `had` (n, G).

    The robot has had these; the first walked, and reached so much there. The gait near it should gain on the robot what
    it gains in the simulators. The new one should do there what it does in them. All meet the same draws. A new one
    that falls more often than both others, by more than `MORE_FALLS`, is not tried, nor one that the robot has had.
    """
    if np.isclose(had, new).all(axis=1).any():
        return False
    seen = expected(trials, np.array([had[0], near, new]), DOUBT, first=COMPARED)
    values, falls = fitness(seen).mean(axis=1), fell(seen).mean(axis=1)
    if falls[2] > falls[:2].max() + MORE_FALLS:
        return False
    return bool(values[2] > reached + values[1] - values[0])

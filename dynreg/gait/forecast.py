"""What gaits will do on a robot on which another one has walked."""

import numpy as np

from dynreg.gait.near import DOUBT
from dynreg.gait.seek import COMPARED, expected
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import Trials

MORE_FALLS = 0.1  # share of the runs by which a gait may fall more often than the one that walked


def new_does_more(trials: Trials, had: np.ndarray, reached: float, near: np.ndarray, new: np.ndarray) -> bool:
    """Whether a new gait (G,) will do more on the robot, on average, than one near the first of `had` (n, G).

    The robot has had these; the first walked, and reached so much there. The gait near it should gain on the robot what
    it gains in the simulators. The new one should do there what it does in them. All meet the same draws. Where one
    falls more often than the gait that walked, by more than `MORE_FALLS`, the one that falls less often will do. A gait
    that the robot has had is not new.
    """
    if np.isclose(had, new).all(axis=1).any():
        return False
    seen = expected(trials, np.array([had[0], near, new]), DOUBT, first=COMPARED)
    values, falls = fitness(seen).mean(axis=1), fell(seen).mean(axis=1)
    if falls[1:].max() > falls[0] + MORE_FALLS:
        return bool(falls[2] < falls[1])
    return bool(values[2] > reached + values[1] - values[0])

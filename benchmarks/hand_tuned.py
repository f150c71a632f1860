"""A simulator that is tuned by hand, as paper D's was to which its search is held, in place of a person.

The paper says no more of it. Here a person knows the rate of the commands and changes, one at a time, the three
parameters that are the usual suspects: friction of the feet, and torque and speed of the motors. What makes the replay
of the log look better stays. All others are nominal.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.robot import Robot

TUNED = ("friction", "torque", "joint_speed")
STEPS = (0.3, 0.15, 0.075, 0.0375)  # of the range, up and down, in each lap: 1 + 4 x 3 x 2 = 25 replays


@dataclass(frozen=True, eq=False)
class HandTuned:
    """Parameters (P,), and the replay error after each of the replays."""

    values: np.ndarray
    errors: list[float]


def hand_tuned(robot: Robot, log: Recording, threads: int = 1) -> HandTuned:
    """Tune a robot's simulator to all of a log. Raises LogError where it cannot be replayed."""
    cut = data(robot, log)
    replayer, every = Replayer(robot, cut.windows, threads), np.arange(len(cut.windows))

    def judged(unit: np.ndarray) -> np.ndarray:
        return errors(replayer.residuals(cut.values_of(unit), every)).mean(axis=1)

    best = cut.with_known(robot.space.to_unit(robot.space.nominal))
    told = [float(judged(best[None])[0])]
    for step in STEPS:
        for name in TUNED:
            tries = np.tile(best, (2, 1))
            at = robot.space.names.index(name)
            tries[:, at] = np.clip(best[at] + np.array([-step, step]), 0.0, 1.0)
            found = judged(tries)
            if found.min() < min(told):
                best = tries[int(found.argmin())]
            told += found.tolist()
    return HandTuned(cut.values_of(best), told)

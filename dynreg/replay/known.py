"""What a recording tells of a robot's parameters before anything is fitted."""

import numpy as np

from dynreg.data.recording import Recording
from dynreg.sim.robot import Robot


def known_values(robot: Robot, recording: Recording) -> np.ndarray:
    """(P,) what a recording tells of the parameters marked `known` (its command rate), NaN elsewhere."""
    values = np.full(len(robot.space), np.nan)
    for i, setters in enumerate(robot.setters):
        if robot.space.parameters[i].known and any(a.root == "control" and a.path == "rate" for a in setters):
            gaps = np.concatenate([np.diff(e.time) for e in recording.episodes if len(e.time) > 1])
            values[i] = 1.0 / np.median(gaps)
    return values

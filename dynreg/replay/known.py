"""What a recording tells of a robot's parameters before anything is fitted: its command rate."""

import numpy as np

from dynreg.data.recording import Recording
from dynreg.sim.robot import Robot


def known_values(robot: Robot, recording: Recording) -> np.ndarray:
    """(P,) what a recording tells of the parameters marked `known` (its command rate), NaN elsewhere."""
    values, told = np.full(len(robot.space), np.nan), _told(robot)
    if told.any():
        gaps = np.concatenate([np.diff(e.time) for e in recording.episodes if len(e.time) > 1])
        values[told] = 1.0 / np.median(gaps)
    return values


def nominal_known(robot: Robot) -> np.ndarray:
    """(P,) what a recording at the nominal command rate tells, NaN elsewhere."""
    return np.where(_told(robot), robot.space.nominal, np.nan)


def command_rate(robot: Robot, known: np.ndarray) -> float:
    """Commands a second [Hz]: what a recording tells, of its `known` values (P,), else the robot's own."""
    told = known[_told(robot)]
    return float(told[0]) if len(told) and not np.isnan(told[0]) else robot.rate


def _told(robot: Robot) -> np.ndarray:
    """(P,) the parameters that every log tells."""
    return np.array(
        [
            p.known and any(a.root == "control" and a.path == "rate" for a in setters)
            for p, setters in zip(robot.space.parameters, robot.setters, strict=True)
        ],
        dtype=bool,
    )

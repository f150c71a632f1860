"""Robots like the Khepera of paper C: their parameters, the noise of the tracker that sees them, and their logs."""

import numpy as np

from dynreg.rng import stream
from dynreg.timed.commands import Commands, drawn
from dynreg.timed.compare import FACTORS
from dynreg.timed.unicycle import KHEPERA, LAUT, unicycle

TRACK = 0.0884  # m
CUT = (slice(0, 1000), slice(1000, 1230), slice(1230, 1460))
TRUTHS = {
    "Table II": KHEPERA,
    "Table II again": KHEPERA,
    "Laut": LAUT,
    "half way": 0.5 * (KHEPERA + LAUT),
    "slower": KHEPERA * [1.3, 1.3, 1.0, 1.0, 1.0, 1.0],
}
# mean absolute errors, Table III: cm, cm, degrees
PUBLISHED = {
    "network": (0.4483, 0.6241, 3.0239),
    "dynamic": (0.3467, 0.3628, 4.1985),
    "kinematic": (1.0093, 1.2788, 13.2385),
}
NOISE = (
    np.array(PUBLISHED["dynamic"]) / FACTORS * np.sqrt(np.pi / 2)
)  # 1 sigma, of that mean size [m, m, rad]


def log_of(seed: int, name: str) -> tuple[Commands, np.ndarray]:
    """Commands (n,) of a hidden robot, and its displacements (n, 3) as they are measured."""
    number = list(TRUTHS).index(name)
    commands = drawn(CUT[-1].stop, stream(seed, "commands", number))
    moved = unicycle(commands, TRUTHS[name], TRACK)
    return commands, moved + NOISE * stream(seed, "tracker", number).standard_normal(moved.shape)

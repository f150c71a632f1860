"""A base that no displacement table holds: what a command does depends on the one before it.

Speed and yaw rate follow what the wheels give with the lags of the unicycle (Pretorius et al., Table II), and a worn
wheel gives less only where it drives: told to turn slower than before, it coasts.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.timed.commands import Commands
from dynreg.timed.unicycle import KHEPERA, unicycle

STEP = 0.05  # s: about half of the shorter lag; within 0.1 mm of steps of 1 ms (tests/timed/test_worn.py)


@dataclass(frozen=True)
class WornWheels:
    """What the left and the right wheel give of what they are told, where it is no less than before it.

    parameters : the unicycle's six, or those of Table II.
    """

    left: float
    right: float
    parameters: tuple[float, ...] = tuple(KHEPERA)

    def moved(self, told: Commands, track: float) -> np.ndarray:
        """(n, 3) displacements [m, m, rad] of commands (n,), the wheels `track` [m] apart.

        A command begins with the speeds that the one before it settled at, had it been held.
        """
        sides = (
            (self.left, told.left, told.left_before),
            (self.right, told.right, told.right_before),
        )
        now = [np.where(np.abs(asked) < np.abs(before), 1.0, gain) * asked for gain, asked, before in sides]
        earlier = [gain * before for gain, _, before in sides]
        given = Commands(*now, told.seconds, *earlier)
        return unicycle(given, np.array(self.parameters), track, step=STEP)

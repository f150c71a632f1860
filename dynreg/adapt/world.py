"""The world of Back to Reality: simulators and a robot in which gaits are played, and how what came of it is kept."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.adapt.journalled import Outcome
from dynreg.search.journal import Journal


@dataclass(frozen=True, eq=False)
class World:
    """What can be asked, and how it is kept.

    play : fitness (s, n) of gaits (n, G) in simulators (s, P), 0 for a fall. trial : what a gait (G,) comes to on the
    robot; BudgetError where no more is allowed. rng, journal : of a step, by its name. periodic : (G,) genes
    that run round. played : gaits (n, G) as the robot plays them, in the unit cube.
    """

    play: Callable[[np.ndarray, np.ndarray], np.ndarray]
    trial: Callable[[np.ndarray], Outcome]
    rng: Callable[[str], np.random.Generator]
    journal: Callable[[str], Journal | None] = lambda _: None
    periodic: np.ndarray | None = None
    played: Callable[[np.ndarray], np.ndarray] = lambda gaits: gaits
    progress: Callable[[str, int, int], None] = lambda *_: None

    def apart(self, gait: np.ndarray, others: np.ndarray) -> np.ndarray:
        """(n,) the largest difference of a gene between gaits (G,) and (n, G)."""
        difference = np.abs(gait - others)
        if self.periodic is not None:
            difference = np.where(self.periodic, np.minimum(difference, 1.0 - difference), difference)
        return difference.max(axis=1)

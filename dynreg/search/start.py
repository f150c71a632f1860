"""Where a search sets out, whichever it is."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Start:
    """Where a search sets out in the unit cube.

    dimensions : P. rng : of all draws. batch : candidates of one ask. point : (P,) the best that is known; None where
    nothing is. periodic : (P,) dimensions that run round. steps : (P,) how far to step at first, 1 sigma, such as a
    search before ended with; None for the usual. Those that adapt a step for each dimension follow it (es, cma).
    """

    dimensions: int
    rng: np.random.Generator
    batch: int
    point: np.ndarray | None = None
    periodic: np.ndarray | None = None
    steps: np.ndarray | None = None

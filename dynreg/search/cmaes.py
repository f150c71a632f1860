"""CMA-ES by ask and tell (library `cma`), in the unit cube."""

import numpy as np

from dynreg.errors import UsageError
from dynreg.search.start import Start
from dynreg.search.turns import Turns

SIGMA = 0.12  # first step, of the range: our choice


class CmaEs(Turns):
    """Covariance matrix adaptation (Hansen, arXiv 1604.00772) with box bounds [0, 1].

    Parameters
    ----------
    start : (P,) where to begin. rng : of all draws. sigma : first step size in the unit cube. batch : candidates of one
    ask. periodic : (P,) dimensions that run round: they have no bounds, and what is asked lies in [0, 1) all the same.
    steps : (P,) first step sizes that differ, in place of sigma; none counts as more than a third of the range.
    Raises UsageError for a batch of one.
    """

    def __init__(
        self,
        start: np.ndarray,
        *,
        rng: np.random.Generator,
        sigma: float = SIGMA,
        batch: int | None = None,
        periodic: np.ndarray | None = None,
        steps: np.ndarray | None = None,
    ):
        import cma

        self._round = np.zeros(len(start), dtype=bool) if periodic is None else periodic
        bounds = [[None if free else edge for free in self._round] for edge in (0.0, 1.0)]
        options = {"bounds": bounds, "verbose": -9, "tolflatfitness": 50}
        # no draw comes from numpy's global generator
        options |= {"seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape)}
        if batch is not None:
            if batch < 2:
                raise UsageError(f"{batch} candidates of one ask", expected="2 or more", do="correct it")
            options["popsize"] = batch
        if steps is not None:
            options["CMA_stds"] = np.minimum(steps, 1.0 / 3.0) / sigma
        if len(start) == 1:
            options["maxstd"] = np.inf  # the library fails where it limits the step of a single dimension
        self._search = cma.CMAEvolutionStrategy(np.clip(start, 0.0, 1.0), sigma, options)

    def candidates(self) -> np.ndarray:
        """(n, P) draws of the distribution."""
        self._drawn = self._search.ask()
        return self._inside(np.array(self._drawn))

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """The distribution moves to what is better."""
        self._search.tell(self._drawn, [float(x) for x in losses])

    @property
    def stopped(self) -> bool:
        """Whether the search has converged."""
        return bool(self._search.stop())

    @property
    def best(self) -> np.ndarray:
        """(P,) the best candidate so far."""
        return self._inside(np.array(self._search.result.xbest))

    @property
    def middle(self) -> np.ndarray:
        """(P,) the middle of what is asked next: where losses are noisy a better bet than the best candidate."""
        return self._inside(self._search.result.xfavorite)

    @property
    def steps(self) -> np.ndarray:
        """(P,) standard deviation of what is asked next, but for what the bounds change."""
        return np.array(self._search.result.stds)

    def _inside(self, x: np.ndarray) -> np.ndarray:
        return np.where(self._round, np.mod(x, 1.0), x)


def begin(start: Start) -> CmaEs:
    """About the point that is known, else the middle of the cube."""
    point = np.full(start.dimensions, 0.5) if start.point is None else start.point
    return CmaEs(point, rng=start.rng, batch=start.batch, periodic=start.periodic, steps=start.steps)

"""An evolution strategy by ask and tell, in the unit cube: the search of paper E, with one step for each gene."""

import numpy as np

from dynreg.errors import UsageError
from dynreg.search.start import Start
from dynreg.search.turns import Turns, ranked

STEP = 0.1  # first step, of the range
CARRIED = 0.02  # of the range: first step of a gene that an earlier search has fitted
# Below the least step a gene would hardly ever move again. An even draw from the range deviates by 0.29.
LEAST, MOST = 1e-5, 0.3


class EvolutionStrategy(Turns):
    """(mu, lambda) with self-adapted steps: the best children become parents, and all parents die.

    A child has each gene from a random one of its rho parents, and the mean of their steps. Then every step is
    multiplied by a log-normal factor, of which one part is common to all genes, and every gene takes a Gaussian step
    (Schwefel, Evolution and Optimum Seeking, 1995; Laue and Hebbel, 2008). So steps that lead to good children go on
    with these.

    A gene that would leave its range is reflected at the bound. By clipping, half of all steps from a bound would
    have no length, and nothing would tell long ones from short ones there.

    Parameters
    ----------
    start : (P,) what the first children descend from. rng : of all draws. mu : parents. children : lambda, the
    candidates of one ask. rho : parents of one child. steps : (P,) first steps, 1 sigma, of the range; `STEP` without
    them. periodic : (P,) dimensions that run round.
    Raises UsageError for sizes that do not fit each other.
    """

    def __init__(
        self,
        start: np.ndarray,
        *,
        rng: np.random.Generator,
        mu: int = 5,
        children: int = 25,
        rho: int = 2,
        steps: np.ndarray | None = None,
        periodic: np.ndarray | None = None,
    ):
        if not 1 <= rho <= mu < children:
            raise UsageError(
                f"rho {rho}, mu {mu}, children {children}",
                expected="1 <= rho <= mu < children: a child's parents, all parents, and children to choose from",
                do="correct them",
            )
        self._rng, self._rho, self._shape = rng, rho, (children, len(start))
        self._round = np.zeros(len(start), dtype=bool) if periodic is None else periodic
        first = np.full(len(start), STEP) if steps is None else np.clip(steps, LEAST, MOST)
        self._parents, self._parents_steps = np.tile(self._inside(start), (mu, 1)), np.tile(first, (mu, 1))

    def candidates(self) -> np.ndarray:
        """(children, P) of the parents."""
        rng, (many, genes) = self._rng, self._shape
        mates = rng.random((many, len(self._parents))).argsort(axis=1)[:, : self._rho]
        whose = np.take_along_axis(mates, rng.integers(self._rho, size=self._shape), axis=1)
        common = rng.standard_normal((many, 1)) / np.sqrt(2.0 * genes)
        own = rng.standard_normal(self._shape) / np.sqrt(2.0 * np.sqrt(genes))
        steps = self._parents_steps[mates].mean(axis=1) * np.exp(common + own)
        self._steps = np.clip(steps, LEAST, MOST)
        drawn = self._parents[whose, np.arange(genes)] + self._steps * rng.standard_normal(self._shape)
        return self._inside(drawn)

    def learn(self, asked: np.ndarray, losses: np.ndarray) -> None:
        """The best children are the next parents; a loss that is NaN is the worst."""
        best = ranked(losses, self._rng)[0][: len(self._parents)]
        self._parents, self._parents_steps = asked[best], self._steps[best]

    @property
    def steps(self) -> np.ndarray:
        """(P,) mean of the parents' steps, of the range: what the next children begin with, or a later search."""
        return self._parents_steps.mean(axis=0)

    @property
    def middle(self) -> np.ndarray:
        """(P,) mean of the parents."""
        apart = self._parents - self._parents[0]
        apart = np.where(self._round, np.mod(apart + 0.5, 1.0) - 0.5, apart)  # the short way round
        return self._inside(self._parents[0] + apart.mean(axis=0))

    def _inside(self, x: np.ndarray) -> np.ndarray:
        return np.where(self._round, np.mod(x, 1.0), 1.0 - np.abs(1.0 - np.mod(x, 2.0)))


def begin(start: Start) -> EvolutionStrategy:
    """About the point that is known, else the middle of the cube; a fifth of the children become parents."""
    point = np.full(start.dimensions, 0.5) if start.point is None else start.point
    mu = max(start.batch // 5, 1)
    return EvolutionStrategy(
        point,
        rng=start.rng,
        mu=mu,
        children=start.batch,
        rho=min(2, mu),
        steps=start.steps,
        periodic=start.periodic,
    )

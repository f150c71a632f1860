"""The paper's cross-loss, searched for on the degree-capped graph of the entries (D, Algorithm 1)."""

import numpy as np

from dynreg.distance.cross_loss import CrossLoss
from dynreg.distance.one_sided import rank as by_one_sided
from dynreg.distance.population import JUDGED_ON
from dynreg.distance.query import DistanceQuery, Ranked
from dynreg.distance.rows import thin
from dynreg.errors import UsageError
from dynreg.index import search, search_printed
from dynreg.models.losses import losses
from dynreg.rng import stream

REACHED = 60  # entries that a search of the graph keeps


def held_out(asked: DistanceQuery) -> Ranked:
    """Best-first, own losses on held-out rows."""
    return _rank(asked, asked.population.cross_loss, asked.rows.held)


def training(asked: DistanceQuery) -> Ranked:
    """Best-first, own losses on training rows, the query's too."""
    return _rank(asked, asked.population.cross_loss_train, asked.rows.train)


def printed(asked: DistanceQuery) -> Ranked:
    """The paper's Algorithm 1 as printed, k = 5, with 4 restarts; own losses on held-out rows."""
    return _rank(asked, asked.population.cross_loss, asked.rows.held, as_printed=True)


def _rank(
    asked: DistanceQuery,
    distance: CrossLoss,
    rows: tuple[np.ndarray, np.ndarray],
    *,
    as_printed: bool = False,
) -> Ranked:
    """Entries by their distance to the recording, a new node of the graph that is judged on some of `rows`.

    What the search did not reach comes after what it found, by one-sided distance and without a number.
    """
    population = asked.population
    if asked.graph is None:
        raise UsageError(
            f"population {population.id[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link, or use --distance one_sided",
        )
    x, y = rows
    some = thin(len(x), JUDGED_ON, population.shared.seed, "query held")
    x, y = x[some], y[some]
    to = distance.query(asked.model, x, y, float(losses(asked.model, x, y)[0]))
    wide = min(REACHED, len(population))
    rng = stream(population.shared.seed, "search")
    if as_printed:
        found = search_printed(asked.graph, to, 5, rng, restarts=4)
    else:
        found = search(asked.graph, to, wide, rng, ef=wide)
    keep = np.isin(found.ids, asked.allowed)
    rest = by_one_sided(asked, np.setdiff1d(asked.allowed, found.ids)).order
    order = np.concatenate([found.ids[keep], rest])
    scores = np.concatenate([found.distances[keep], np.full(len(rest), np.nan)])
    return Ranked(order, scores, found.evaluations)

"""The paper's cross-loss, searched for on the degree-capped graph of the entries (D, Algorithm 1)."""

import numpy as np

from dynreg.distance.cross_loss import JUDGED_ON, CrossLoss
from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import thin
from dynreg.errors import UsageError
from dynreg.index import To, search, search_printed
from dynreg.models.losses import losses
from dynreg.models.threads import single_threaded
from dynreg.rng import stream

REACHED = 50  # entries that a search of the graph keeps


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

    All that are allowed are judged with `exact`, and where a walk finds too few.
    """
    population = asked.population
    if population.graph is None:
        raise UsageError(
            f"population {population.id[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link, or use --distance one_sided",
        )
    x, y = rows
    some = thin(len(x), JUDGED_ON, population.shared.seed, "query held")
    x, y = x[some], y[some]
    to = distance.query(asked.model, x, y, float(losses(asked.model, x, y)[0]))
    walked = 0
    if not asked.exact:
        found = _walked(asked, to, as_printed)
        if len(found.order) >= asked.at_least:
            return found
        walked = found.evaluations  # asked for in vain, but asked for
    return in_order(asked.allowed, to(asked.allowed), walked + len(asked.allowed))


def _walked(asked: DistanceQuery, to: To, as_printed: bool) -> Ranked:
    graph, rng = asked.population.graph, stream(asked.population.shared.seed, "search")
    with single_threaded():  # a step asks for too little to share among cores
        if as_printed:
            found = search_printed(graph, to, max(5, asked.wanted), rng, restarts=4)
        else:
            kept = min(max(REACHED, asked.wanted, asked.at_least), len(asked.allowed))
            found = search(graph, to, kept, rng, ef=kept, among=asked.allowed)
    keep = np.isin(found.ids, asked.allowed)
    return Ranked(found.ids[keep], found.distances[keep], found.evaluations)

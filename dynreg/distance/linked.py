"""The paper's cross-loss (D): its nearest are foreseen, or found as printed, by a walk over the graph (Algorithm 1).

Who is near to a recording by cross-loss is less its likeness than an entry's own: some, hubs, are near to everybody
(measured: of the five nearest of a quadruped among 10,000, one in eight is among its 50 nearest by embedding, three
in eight among the 50 entries whose links are shortest). Hubs are the entries whose rows every model predicts well. So
the search knows of each entry how well some models, the pivots, predict its rows, beside its embedding and own loss.
"""

import numpy as np

from dynreg.distance.cross_loss import JUDGED_ON, CrossLoss
from dynreg.distance.foreseen import Effort, gaussian, seek
from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import thin
from dynreg.errors import UsageError
from dynreg.index import To, search_printed
from dynreg.models.losses import losses
from dynreg.models.threads import single_threaded
from dynreg.rng import stream

HUBS, LIKE, RANDOM = 32, 16, 16  # entries that are judged first: hubs, the nearest by embedding, any
# of embeddings and of hardness beside what else is known of entries: a hardness of 3 finds as much
SPREAD = 2.0
TINY = 1e-12  # smaller losses and distances count as this


def effort(entries: int) -> Effort:
    """What a search among so many entries spends: its judgements grow like n^0.22.

    By twelve quadrupeds that report nothing, among the 3,500 of 10,000 that may be asked: recall@5 1.00 with 416
    judged, 0.98 with 300. With the length of each entry's links for pivots 0.94, by a ridge map of these 0.88; a walk
    over the graph 0.63 with 568, 0.73 with 760. Of six servos among 30,000 1.00 with 672. A noise of 0.03 to 0.3 with
    a slope of 1 to 0.1 finds 0.98 of quadrupeds.
    """
    return Effort(gaussian(reach=3.0, noise=0.1, slope=0.3), least=round(250 * (entries / 400) ** 0.22))


def held_out(asked: DistanceQuery) -> Ranked:
    """By own losses on held-out rows."""
    return _rank(asked, asked.population.cross_loss, asked.rows.held)


def training(asked: DistanceQuery) -> Ranked:
    """By own losses on training rows, the query's too."""
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

    All that are allowed are judged with `exact`, and where the search finds too few.
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
    before = 0
    if not asked.exact:
        with single_threaded():  # a step asks for too little to share among cores
            found = _printed(asked, to) if as_printed else _sought(asked, to, distance.own)
        if len(found.order) >= asked.at_least:
            return found
        before = found.evaluations  # asked for in vain, but asked for
    return in_order(asked.allowed, to(asked.allowed), before + len(asked.allowed))


def _printed(asked: DistanceQuery, to: To) -> Ranked:
    rng = stream(asked.population.shared.seed, "search")
    found = search_printed(asked.population.graph, to, max(5, asked.wanted), rng, restarts=4)
    keep = np.isin(found.ids, asked.allowed)
    return Ranked(found.ids[keep], found.distances[keep], found.evaluations)


def _sought(asked: DistanceQuery, to: To, own: np.ndarray) -> Ranked:
    """The entries that are judged on the way to the nearest; see `foreseen.seek`."""
    allowed, vectors = asked.allowed, asked.population.vectors[asked.allowed]
    hard = hardness(own[allowed], asked.population.judged.crossed[allowed])
    like = np.square(vectors - asked.vector).sum(axis=1)
    drawn = stream(asked.population.shared.seed, "search").permutation(len(allowed))
    easy = np.where(np.isfinite(own[allowed]), hard.mean(axis=1), np.inf)
    hubs = np.argsort(easy, kind="stable")
    starts = (hubs[:HUBS], np.argsort(like, kind="stable")[:LIKE], drawn[:RANDOM])

    def missed(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        far = to(allowed[at])
        return np.log(np.maximum(far, TINY) / TINY)[:, None].astype(np.float32), far

    found = seek(
        places(vectors, own[allowed], hard, like),
        missed,
        max(asked.wanted, asked.at_least),
        np.concatenate(starts),
        effort(len(allowed)),
    )
    return Ranked(allowed[found.order], found.distance, found.evaluations)


def hardness(own: np.ndarray, crossed: np.ndarray) -> np.ndarray:
    """(M, K) logarithms of what pivots lose on the held-out rows of entries (M, K), over their own losses (M,).

    A pivot that predicts no number for some entry tells nothing of any.
    """
    hard = np.log(crossed + TINY) - np.log(own + TINY)[:, None]
    return np.where(np.isfinite(hard[np.isfinite(own)]).all(axis=0), hard, 0.0)


def places(vectors: np.ndarray, own: np.ndarray, hard: np.ndarray, like: np.ndarray) -> np.ndarray:
    """(M, D' + K + 2) what a search knows of entries: embeddings (M, D'), `hardness` (M, K), own losses (M,), and how
    far they are by embedding (M,), squared.

    The first two have a spread of `SPREAD`, summed over coordinates; each of the others has one of 1. Own losses count
    by their logarithms: the search foresees logarithms of distances, which fall as own losses rise.
    """
    # a model that predicts no number must not hide the others
    sound = np.isfinite(vectors).all(axis=1) & np.isfinite(own)

    def spread(told: np.ndarray, wide: float) -> np.ndarray:
        middle, size = told[sound].mean(axis=0), np.sqrt(told[sound].var(axis=0).sum())
        return (told - middle) * (wide / (size + TINY))

    parts = (vectors, SPREAD), (hard, SPREAD), (np.log(own + TINY)[:, None], 1.0), (like[:, None], 1.0)
    return np.column_stack([spread(*part) for part in parts])

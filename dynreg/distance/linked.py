"""The paper's cross-loss (D): its nearest are foreseen, or found as printed, by a walk over the graph (Algorithm 1).

Who is near to a recording by cross-loss is less its likeness than an entry's own: some, hubs, are near to everybody
(measured: of the five nearest of a quadruped among 10,000, one in eight is among its 50 nearest by embedding, three
in eight among the 50 entries whose links are shortest). A graph with more links or more candidates for them finds no
more of them, so the search knows of each entry how long its links are, beside its embedding and its own loss.
"""

import numpy as np

from dynreg.distance.cross_loss import JUDGED_ON, CrossLoss
from dynreg.distance.foreseen import Effort, gaussian, seek
from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.distance.rows import thin
from dynreg.errors import UsageError
from dynreg.index import Graph, To, search_printed
from dynreg.models.losses import losses
from dynreg.models.threads import single_threaded
from dynreg.rng import stream

HUBS, LIKE, RANDOM = 32, 16, 16  # entries that are judged first: hubs, the nearest by embedding, any
EMBEDDED = (
    2.0  # spread of embeddings beside what else is known of entries; with 1 or 4 a search finds no more
)
TINY = 1e-12  # smaller own losses, links and distances count as this


def effort(entries: int) -> Effort:
    """What a search among so many entries spends: its judgements grow like n^0.22.

    By twelve quadrupeds that report nothing, among the 400 of 1,000 that may be asked: recall@5 1.00 with 256 judged,
    0.98 with 190. Among the 3,500 of 10,000: 0.97 with 421 judged; by a ridge map 0.88, a walk over the graph 0.63 with
    568, 0.73 with 760. Of two servos among 30,000 1.00 with 672. A reach of 2 to 5 and a noise of 0.1 to 0.3 find as
    much of quadrupeds; entries beside the best, or each half of the distance foreseen by itself, no more.
    """
    return Effort(gaussian(reach=3.0, noise=0.3, slope=0.1), least=round(250 * (entries / 400) ** 0.22))


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
    hub = link_lengths(asked.population.graph)[allowed]
    like = np.square(vectors - asked.vector).sum(axis=1)
    drawn = stream(asked.population.shared.seed, "search").permutation(len(allowed))
    starts = (np.argsort(hub, kind="stable")[:HUBS], np.argsort(like, kind="stable")[:LIKE], drawn[:RANDOM])

    def missed(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        far = to(allowed[at])
        return np.log(np.maximum(far, TINY) / TINY)[:, None].astype(np.float32), far

    found = seek(
        places(vectors, own[allowed], hub, like),
        missed,
        max(asked.wanted, asked.at_least),
        np.concatenate(starts),
        effort(len(allowed)),
    )
    return Ranked(allowed[found.order], found.distance, found.evaluations)


def places(vectors: np.ndarray, own: np.ndarray, hub: np.ndarray, like: np.ndarray) -> np.ndarray:
    """(M, D' + 3) what a search knows of entries: embeddings (M, D'), own losses (M,), lengths of links (M,), and how
    far they are by embedding (M,), squared.

    Embeddings have a spread of `EMBEDDED`, summed over coordinates; each of the others has one of 1. Own losses count
    by their logarithms: the search foresees logarithms of distances, which fall as own losses rise.
    """
    sound = np.isfinite(vectors).all(axis=1)  # a model that predicts no number must not hide the others
    centre, spread = vectors[sound].mean(axis=0), np.sqrt(vectors[sound].var(axis=0).sum()) + 1e-9
    rest = np.column_stack([np.log(own + TINY), hub, like])
    middle, size = rest[sound].mean(axis=0), rest[sound].std(axis=0) + TINY
    return np.column_stack([(vectors - centre) * (EMBEDDED / spread), (rest - middle) / size])


def link_lengths(graph: Graph) -> np.ndarray:
    """(M,) medians of the lengths of each entry's links: short for hubs, which are near to everybody.

    An entry without a measured link has the median of the others.
    """
    entry = np.repeat(np.arange(len(graph.lengths)), [len(known) for known in graph.lengths])
    length = np.concatenate([np.zeros(0), *graph.lengths])
    known = np.isfinite(length)
    entry, length = entry[known], length[known]
    length = length[np.lexsort((length, entry))]
    count = np.bincount(entry, minlength=len(graph.lengths))
    if not len(length):
        return np.zeros(len(count))
    first = np.minimum(np.cumsum(count) - count, len(length) - 1)
    middle = 0.5 * (
        length[first + np.maximum(count - 1, 0) // 2]
        + length[np.minimum(first + count // 2, len(length) - 1)]
    )
    return np.where(count > 0, middle, np.median(middle[count > 0]))

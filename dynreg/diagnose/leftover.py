"""Causes that no library has: on which signals of a joint does what is left of its acceleration depend?

A small regression, judged on trajectories that it has not seen, against a null of the same residuals paired with
the signals of other trajectories.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream, stream_seed

# Of what four servos whose cause the library lacks leave, bench_constants tells shares that sum to 1.19, of three that
# lack nothing 0; and the same with LEAST and MORE of half, NULLS of 6 and 24, MARGIN of 1 and 1.5, NEAR of half and
# twice, WILD of 0 and twice (1.19 to 1.20). Two FOLDS tell 1.15, eight 1.23 in twice the time; MOST of 1500, every
# other row of these logs, 0.83; TREES, LEAVES, BINS and FARTHEST of half 0.90, of twice 1.19 in twice the time.
LEAST = 0.02  # held-out R^2 below which nothing is said
MORE = 0.05  # of the whole R^2: the least that a further signal must add
NULLS = 12  # residuals paired with the wrong signals
MARGIN = 1.25  # times the best of which the true pairing must explain
FEWEST = 60  # samples below which nothing can be said: three leaves of a tree
MOST = 3000  # samples that are fitted
FOLDS = 4  # into which trajectories, or blocks of them, are held out
FARTHEST = 5.0  # standard deviations of a signal: what lies beyond bends the ridge of its squares no more
LEAVES, FEWEST_IN_LEAF, PARTS = 8, 20, 200  # of a tree; samples in a leaf, or a share of one in so many
TREES, LEARNING, BINS = 16, 0.35, 64  # in a row, how far each goes, and how finely signals are cut
WILD = 0.002  # of the samples, at either end: a few wild ones (an impact, a lost packet) would decide the fit
# where two signals explain the same within NEAR, the earlier is named: a sign is simpler than what it is the sign of
NEAR = 0.02
SIMPLEST = ("sign_of_velocity", "velocity", "position", "load", "command_error", "command", "time")


@dataclass(frozen=True, eq=False)
class Residuals:
    """What a simulator leaves of one joint's acceleration, and what the joint was doing.

    values : (N,) measured - predicted [unit]. signals : {name: (N,)}. trajectory : (N,) number of the trajectory,
    rows in the order of time. NaN residuals are left out; NaN signals are unknown.
    Raises UsageError where the lengths differ.
    """

    joint: str
    unit: str
    values: np.ndarray
    signals: Mapping[str, np.ndarray]
    trajectory: np.ndarray

    def __post_init__(self):
        lengths = {"values": self.values.shape, "trajectory": self.trajectory.shape}
        lengths |= {name: signal.shape for name, signal in self.signals.items()}
        wrong = {name: shape for name, shape in lengths.items() if shape != (len(self.values),)}
        if wrong:
            name, shape = next(iter(wrong.items()))
            raise UsageError(
                f"{name!r} of joint {self.joint!r} has shape {shape}",
                expected=f"({len(self.values)},), one for each residual",
                do="give all of them at the same rows",
            )


@dataclass(frozen=True)
class Dependence:
    """Of one joint and signal, as shares of the residual's variance on unseen trajectories.

    share : what it adds to those named before it; the shares of a joint sum to what its few signals explain together.
    """

    joint: str
    signal: str
    share: float


@dataclass(frozen=True)
class Leftover:
    """What can be predicted of a joint's residual: nothing where `explained` is 0, and all shares are then 0.

    explained : held-out R^2 with all signals, or with those that have a share where that is more. null : the largest
    of residuals that were paired with wrong signals.
    rows : one for each signal, largest share first. size : standard deviation of the residual [unit].
    """

    joint: str
    unit: str
    explained: float
    null: float
    size: float
    samples: int
    trajectories: int
    rows: tuple[Dependence, ...]


def leftover(residuals: Residuals, *, seed: int = 0) -> Leftover:
    """Fit what is left of a joint on its signals and say which of them tell it, and how much.

    Regressions are ridge (with squares and sizes) and gradient-boosted trees, the better of both; held out by
    trajectory, by blocks of rows where there are fewer than 8 trajectories.
    """
    import sklearn.ensemble  # noqa: F401  - limits reach only what is loaded
    from threadpoolctl import threadpool_limits

    joint, (y, table, names, block) = residuals.joint, _rows(residuals)
    numbers, at = np.unique(block, return_inverse=True)
    told, null, share = 0.0, 0.0, {}
    with threadpool_limits(1):  # threads cost such small fits far more than they save
        if len(y) >= FEWEST and names and np.std(y) > 0 and len(numbers) >= FOLDS:
            order = stream(seed, "leftover folds", joint).permutation(len(numbers))
            judge = _Judge(y, table, order[at] % FOLDS, seed)  # a block is in one fold only
            whole = judge.explained(list(range(len(names))))
            null = _null(judge, block, whole, joint, seed)
            if whole >= max(LEAST, MARGIN * null):
                share = _shares(judge, names, whole)
                told = max(whole, sum(share.values()))
    rows = [Dependence(joint, name, share.get(name, 0.0)) for name in residuals.signals]
    trajectories = len(np.unique(residuals.trajectory[np.isfinite(residuals.values)]))
    return Leftover(
        joint,
        residuals.unit,
        explained=told,
        null=null,
        size=float(np.std(y)) if len(y) else 0.0,
        samples=len(y),
        trajectories=trajectories,
        rows=tuple(sorted(rows, key=lambda r: -r.share)),
    )


class _Judge:
    """Share of the variance of y (N,) that columns of a table (N, K) explain on folds (N,) that were not seen."""

    def __init__(self, y: np.ndarray, table: np.ndarray, folds: np.ndarray, seed: int):
        self.y, self.table, self.folds = y, table, folds
        self.seed = stream_seed(seed, "leftover trees") % 2**31

    def explained(self, columns: list[int]) -> float:
        """R^2 of the better of two regressions, against the mean of what was seen; 0 without columns."""
        if not columns:
            return 0.0
        x = self.table[:, columns]
        best = -np.inf
        for regression in (self._ridge, self._trees):
            left, plain = 0.0, 0.0
            for fold in range(FOLDS):
                seen, unseen = self.folds != fold, self.folds == fold
                predicted = regression(x[seen], self.y[seen], x[unseen])
                left += np.sum((self.y[unseen] - predicted) ** 2)
                plain += np.sum((self.y[unseen] - self.y[seen].mean()) ** 2)
            best = max(best, 1.0 - left / plain)
        return float(best)

    @staticmethod
    def _ridge(x: np.ndarray, y: np.ndarray, ask: np.ndarray) -> np.ndarray:
        from sklearn.linear_model import Ridge

        known = np.isfinite(x)
        count = np.maximum(
            known.sum(axis=0), 1
        )  # a signal that no seen trajectory has is as good as constant
        mean = np.where(known, x, 0.0).sum(axis=0) / count
        size = np.maximum(np.sqrt(np.where(known, (x - mean) ** 2, 0.0).sum(axis=0) / count), 1e-12)

        def features(a: np.ndarray) -> np.ndarray:
            z = np.clip(np.nan_to_num((a - mean) / size), -FARTHEST, FARTHEST)
            return np.concatenate([z, z * np.abs(z), z**2, np.abs(z)], axis=1)

        return Ridge(alpha=1.0).fit(features(x), y).predict(features(ask))

    def _trees(self, x: np.ndarray, y: np.ndarray, ask: np.ndarray) -> np.ndarray:
        from sklearn.ensemble import HistGradientBoostingRegressor

        model = HistGradientBoostingRegressor(
            max_iter=TREES,
            learning_rate=LEARNING,
            max_leaf_nodes=LEAVES,
            min_samples_leaf=max(FEWEST_IN_LEAF, len(y) // PARTS),
            l2_regularization=1.0,
            max_bins=BINS,
            early_stopping=False,
            random_state=self.seed,
        )
        return model.fit(x, y).predict(ask)


def _shares(judge: _Judge, names: list[str], whole: float) -> dict[str, float]:
    """What each signal adds, one after the other until none adds enough; a pair where no single signal tells half."""

    def beside(chosen: dict[int, float]) -> dict[int, float]:
        """Scores of the other columns together with those chosen."""
        return {i: judge.explained([*chosen, i]) for i in range(len(names)) if i not in chosen}

    least = max(LEAST, MORE * whole)
    chosen: dict[int, float] = {}
    total, scores = 0.0, beside(chosen)
    alone = list(scores.values())
    if max(alone) < 0.5 * whole and len(names) > 1:
        pairs = {(i, j): judge.explained([i, j]) for i in range(len(names)) for j in range(i)}
        (i, j), together = max(pairs.items(), key=lambda item: item[1])
        if together > max(alone) + least and together > 2 * max(alone):
            # what only acts together is shared evenly
            halves = {
                a: (together + max(alone[a], 0.0) - max(alone[b], 0.0)) / 2 for a, b in ((i, j), (j, i))
            }
            chosen, total = {a: half for a, half in halves.items() if half > 0}, together
            scores = beside(chosen)
    while scores:
        best = max(scores.values())
        if best < total + least:
            break
        near = [i for i, score in scores.items() if score >= best - NEAR * max(whole, best)]
        # what is not among the simplest comes after them
        pick = min(near, key=lambda i: ([*SIMPLEST, names[i]].index(names[i]), -scores[i]))
        if scores[pick] < total + least:
            pick = max(scores, key=lambda i: scores[i])
        chosen[pick] = scores[pick] - total
        total = scores[pick]
        scores = beside(chosen)
    return {names[i]: share for i, share in chosen.items()}


def _rows(residuals: Residuals) -> tuple[np.ndarray, np.ndarray, list[str], np.ndarray]:
    """y (N,), table (N, K) of the signals that vary, their names, and the block (N,) each row is held out with."""
    known = np.flatnonzero(np.isfinite(residuals.values))
    known = known[np.argsort(residuals.trajectory[known], kind="stable")]
    block = _blocks(residuals.trajectory[known])
    every = -(-len(known) // MOST) if len(known) else 1
    known, block = known[::every], block[::every]
    y = residuals.values[known]
    if len(y):
        y = np.clip(y, *np.quantile(y, [WILD, 1.0 - WILD]))
    columns = {}
    for name, signal in residuals.signals.items():
        values = np.where(np.isfinite(signal[known]), signal[known], np.nan)
        if np.isfinite(values).any() and np.nanstd(values) > 1e-9 * max(np.nanmax(np.abs(values)), 1e-300):
            columns[name] = values
    table = np.stack(list(columns.values()), axis=1) if columns else np.empty((len(y), 0))
    return y, table, list(columns), block


def _blocks(trajectory: np.ndarray) -> np.ndarray:
    """(N,) the trajectory of each row, or a run of rows within it where there are fewer than 8 trajectories."""
    numbers, block = np.unique(trajectory, return_inverse=True)
    if not len(numbers) or len(numbers) >= 2 * FOLDS:
        return block
    parts = -(-2 * FOLDS // len(numbers))
    counts = np.bincount(block)
    within = np.arange(len(block)) - np.repeat(np.cumsum(counts) - counts, counts)
    return block * parts + within * parts // counts[block]


def _null(judge: _Judge, block: np.ndarray, whole: float, joint: str, seed: int) -> float:
    """The best R^2 of residuals paired with the wrong signals, at least 0; the search ends where `whole` fails it.

    They are in another order of blocks and shifted: as correlated in time, but of no signal's making.
    """
    best, y = 0.0, judge.y
    for number in range(NULLS):
        if whole < max(LEAST, MARGIN * best):
            break
        rng = stream(seed, "leftover null", joint, number)
        order = rng.permutation(np.unique(block))
        mixed = np.concatenate([y[block == b] for b in order])
        wrong = np.roll(mixed, int(rng.integers(len(y) // 10, len(y) - len(y) // 10)))
        best = max(
            best, _Judge(wrong, judge.table, judge.folds, seed).explained(list(range(judge.table.shape[1])))
        )
    return best

"""Unknown causes: the signals of a joint that predict its unexplained acceleration.

A small regression of the residual on the signals, judged on held-out trajectories, and compared with the same residuals
paired with the signals of other trajectories (a permutation null).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream, stream_seed

# bench_constants: for four servos with an effect outside the library the explained shares sum to 1.19, for three
# without one to 0. The same with half of LEAST and MORE, NULLS of 6 and 24, MARGIN of 1 and 1.5, NEAR of half and
# twice, WILD of 0 and twice (1.19 to 1.20). Two FOLDS give 1.15, eight 1.23 in twice the time; MOST of 1500, every
# other row of these logs, 0.83; half of TREES, LEAVES, BINS and FARTHEST 0.90, twice 1.19 in twice the time.
LEAST = 0.02  # a smaller held-out R^2 counts as zero
MORE = 0.05  # of the whole R^2: the least that a further signal must add
NULLS = 12  # permutations: residuals paired with wrong signals
MARGIN = 1.25  # the true pairing must explain this many times the best permutation
FEWEST = 60  # fewest samples for a fit: three leaves of a tree
MOST = 3000  # most samples for a fit
FOLDS = 4  # of the cross-validation over trajectories, or blocks of them
FARTHEST = (
    5.0  # standard deviations at which a signal is clipped, so that outliers do not dominate its squares
)
LEAVES, FEWEST_IN_LEAF, PARTS = (
    8,
    20,
    200,
)  # of a tree; least samples of a leaf, or one in so many of all samples
TREES, LEARNING, BINS = 16, 0.35, 64  # number of trees, learning rate, bins of each signal
WILD = 0.002  # quantile at either end where residuals are clipped: a few outliers would decide the fit
# of two signals that explain the same within NEAR, the earlier is named: a sign is simpler than the signal itself
NEAR = 0.02
SIMPLEST = ("sign_of_velocity", "velocity", "position", "load", "command_error", "command", "time")


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residual acceleration of one joint, and the signals of the joint at the same rows.

    values : (N,) measured - predicted [unit]. signals : {name: (N,)}. trajectory : (N,) number of the trajectory, rows
    in the order of time. NaN residuals are left out; NaN signals are unknown.
    Raises UsageError if the lengths differ.
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
    """The part of a joint's residual that one signal predicts.

    share : of the residual's variance on held-out trajectories, in addition to the signals before it. The shares of a
    joint sum to what its few signals predict together.
    """

    joint: str
    signal: str
    share: float


@dataclass(frozen=True)
class ResidualFit:
    """How well a joint's signals predict its residual; `explained` and all shares are 0 if they do not.

    explained : held-out R^2 with all signals, or with those that have a share if that is more. null : the largest R^2
    of
    the permutations. rows : one for each signal, the largest share first. size : standard deviation of the residual
    [unit].
    """

    joint: str
    unit: str
    explained: float
    null: float
    size: float
    samples: int
    trajectories: int
    rows: tuple[Dependence, ...]


def fit_residual(residuals: Residuals, *, seed: int = 0) -> ResidualFit:
    """Fit a joint's residual on its signals: the share that each of them predicts.

    The regression is the better of ridge (with squares and absolute values) and gradient-boosted trees. Folds are
    trajectories, or blocks of rows if there are fewer than 8 trajectories.
    """
    import sklearn.ensemble  # noqa: F401  - limits reach only what is loaded
    from threadpoolctl import threadpool_limits

    joint, (y, table, names, block) = residuals.joint, _rows(residuals)
    numbers, at = np.unique(block, return_inverse=True)
    told, null, share = 0.0, 0.0, {}
    with threadpool_limits(1):  # threads slow such small fits down
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
    return ResidualFit(
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
    """Share of the variance of y (N,) that columns of a table (N, K) explain, by cross-validation over folds (N,)."""

    def __init__(self, y: np.ndarray, table: np.ndarray, folds: np.ndarray, seed: int):
        self.y, self.table, self.folds = y, table, folds
        self.seed = stream_seed(seed, "leftover trees") % 2**31

    def explained(self, columns: list[int]) -> float:
        """Held-out R^2 of the better of two regressions, relative to the training mean; 0 without columns."""
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
    """The share that each signal adds, by forward selection; a pair first if no signal explains half."""

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
            # an interaction is shared evenly
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
    """y (N,), table (N, K) of the signals that vary, their names, and the hold-out block of each row (N,)."""
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
    """(N,) the trajectory of each row, or a block of rows within it if there are fewer than 8 trajectories."""
    numbers, block = np.unique(trajectory, return_inverse=True)
    if not len(numbers) or len(numbers) >= 2 * FOLDS:
        return block
    parts = -(-2 * FOLDS // len(numbers))
    counts = np.bincount(block)
    within = np.arange(len(block)) - np.repeat(np.cumsum(counts) - counts, counts)
    return block * parts + within * parts // counts[block]


def _null(judge: _Judge, block: np.ndarray, whole: float, joint: str, seed: int) -> float:
    """The best R^2 of residuals paired with wrong signals, at least 0; it stops as soon as `whole` is too small.

    The blocks of residuals are permuted and shifted: they keep their correlation in time, but depend on no signal.
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

"""A displacement model of measured samples, kept true by Student's t-test.

One cell for each pair of wheel speeds; in each cell, for each axis, samples of what the command moved, as numbers drawn
from a normal distribution. New samples are held against the old ones, and where they differ old samples go until they
do not any more (paper C). What it leaves open is ours: `Rules`.
"""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.errors import UsageError
from dynreg.timed.commands import AXES, FINE


@dataclass(frozen=True)
class Rules:
    """How samples are tested and dropped.

    level : of a test. fresh : generations after which a sample is too old. least : the newest samples of a cell that
    stay in any case (a cell without any could be drawn no more). most : share of a cell's samples that one update may
    remove. welch : do not take variances for equal. together : control the false-discovery rate over all tests of an
    update (Benjamini and Hochberg) in place of the level of each. apart : hold new samples against the old ones alone;
    else, as printed, against all, the new ones among them.
    """

    level: float = 0.05
    fresh: int = 500
    least: int = 5
    most: float = 0.5
    welch: bool = False
    together: bool = False
    apart: bool = True


@dataclass(frozen=True, eq=False)
class DisplacementTable:
    """N samples: cell (N,) of each, values (N, 3) [m, m, rad], generation born (N,), and whether they count (N, 3).

    cells : their number. A sample may count for one axis and not for another.
    """

    cells: int
    cell: np.ndarray
    values: np.ndarray
    born: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, cells: int, cell: np.ndarray, values: np.ndarray, born: int = 0) -> "DisplacementTable":
        """Of measured samples; UsageError for cells that there are not."""
        if len(cell) and not (0 <= cell.min() and cell.max() < cells):
            raise UsageError(
                f"samples of cells {cell.min()} to {cell.max()}",
                expected=f"0 to {cells - 1}",
                do="correct them",
            )
        return cls(cells, cell, values, np.full(len(cell), born), np.ones(values.shape, dtype=bool))

    def moments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Samples that count, their mean and standard deviation: (cells, 3) each; NaN where there are too few."""
        out = np.zeros((3, self.cells, self.values.shape[1]))
        for axis in range(self.values.shape[1]):
            use = self.counts[:, axis]
            where, x = self.cell[use], self.values[use, axis]
            n = np.bincount(where, minlength=self.cells).astype(float)
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = np.bincount(where, x, self.cells) / n
                square = np.bincount(where, (x - mean[where]) ** 2, self.cells)
                out[:, :, axis] = n, mean, np.sqrt(square / (n - 1.0))
        out[2][out[0] < 2] = np.nan
        return out[0], out[1], out[2]

    def joined(self, other: "DisplacementTable") -> "DisplacementTable":
        """With the samples of another table of the same cells behind its own."""
        columns = ("cell", "values", "born", "counts")
        both = (np.concatenate([getattr(self, c), getattr(other, c)]) for c in columns)
        return DisplacementTable(self.cells, *both)


@dataclass(frozen=True, eq=False)
class Tested:
    """What an update found: p-values (cells, 3), NaN where there was no test; which were rejected; samples removed.

    old, new : (cells, 3) means before, and of the new samples. aged : samples dropped for their age.
    """

    p: np.ndarray
    rejected: np.ndarray
    removed: np.ndarray
    old: np.ndarray
    new: np.ndarray
    aged: int

    @property
    def tests(self) -> int:
        """How many there were."""
        return int(np.isfinite(self.p).sum())


def updated(
    table: DisplacementTable, cell: np.ndarray, values: np.ndarray, now: int, rules: Rules | None = None
) -> tuple[DisplacementTable, Tested]:
    """The table with new samples, cells (n,) and values (n, 3), of generation `now`, and what the tests said."""
    rules = rules or Rules()
    known, aged = _without_old(table, now, rules)
    new = DisplacementTable.of(table.cells, cell, values, now)
    merged = known.joined(new)
    p, rejected = rejections(known if rules.apart else merged, new, rules)
    counts = merged.counts.copy()
    removed = np.zeros((table.cells, len(AXES)), dtype=int)
    for at, axis in np.argwhere(rejected):
        removed[at, axis] = _reconcile(merged, counts, len(known.cell), at, axis, rules)
    found = Tested(p, rejected, removed, known.moments()[1], new.moments()[1], aged)
    return replace(merged, counts=counts), found


def rejections(
    known: DisplacementTable, new: DisplacementTable, rules: Rules
) -> tuple[np.ndarray, np.ndarray]:
    """p-values (cells, 3) of cells that both have two samples of or more, NaN elsewhere; and which are rejected."""
    from scipy.stats import false_discovery_control

    p = _p_values(known.moments(), new.moments(), rules.welch)
    there = np.isfinite(p)
    rejected = np.zeros(p.shape, dtype=bool)
    if rules.together and there.any():
        rejected[there] = false_discovery_control(p[there]) < rules.level
    elif not rules.together:
        rejected[there] = p[there] < rules.level
    return p, rejected


def _p_values(
    known: tuple[np.ndarray, np.ndarray, np.ndarray],
    new: tuple[np.ndarray, np.ndarray, np.ndarray],
    welch: bool,
    least: np.ndarray = FINE,
) -> np.ndarray:
    """(cells, k) of two-sided tests on axes whose samples scatter by `least` (k,) at least."""
    from scipy.stats import ttest_ind_from_stats

    (n, mean, deviation), (m, other, spread) = known, new
    deviation, spread = np.maximum(deviation, least), np.maximum(spread, least)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = ttest_ind_from_stats(mean, deviation, n, other, spread, m, equal_var=not welch).pvalue
    return np.where((n >= 2) & (m >= 2), p, np.nan)


def _reconcile(
    merged: DisplacementTable, counts: np.ndarray, old: int, at: int, axis: int, rules: Rules
) -> int:
    """Take old samples of a cell off `counts` until its new ones agree with the rest; how many.

    The first `old` samples of the merged table are those that were known. The smallest goes where they are too small
    on average, the largest where they are too large.
    """
    own = np.flatnonzero((merged.cell == at) & counts[:, axis])
    new = own[own >= old]
    fixed = {*own[np.argsort(-merged.born[own], kind="stable")][: rules.least]}
    held = [int(i) for i in own if i < old]
    most, removed = int(rules.most * len(held)), 0
    fresh = merged.values[new, axis]
    while removed < most:
        rest = merged.values[held, axis]
        against = rest if rules.apart else np.concatenate([rest, fresh])
        known = tuple(np.array([[x]]) for x in (len(against), against.mean(), against.std(ddof=1)))
        others = tuple(np.array([[x]]) for x in (len(fresh), fresh.mean(), fresh.std(ddof=1)))
        if not _p_values(known, others, rules.welch, FINE[[axis]])[0, 0] < rules.level:
            break
        may = [i for i in held if i not in fixed]
        if not may or len(held) <= 2:
            break
        pick = min if against.mean() < fresh.mean() else max
        gone = pick(may, key=lambda i: merged.values[i, axis])
        counts[gone, axis] = False
        held.remove(gone)
        removed += 1
    return removed


def _without_old(table: DisplacementTable, now: int, rules: Rules) -> tuple[DisplacementTable, int]:
    """Without samples older than `fresh` generations, but for the newest of every cell; and how many went."""
    old = table.born < now - rules.fresh
    order = np.lexsort((-table.born, table.cell))
    rank = np.empty(len(order), dtype=int)
    first = np.searchsorted(table.cell[order], table.cell[order], side="left")
    rank[order] = np.arange(len(order)) - first
    stay = ~old | (rank < rules.least)
    kept = DisplacementTable(
        table.cells, table.cell[stay], table.values[stay], table.born[stay], table.counts[stay]
    )
    return kept, int((~stay).sum())

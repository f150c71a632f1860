"""Whether a robot still moves as it did: tests cell by cell, the pattern of what moved, and how often they err.

Student's test of paper C on every cell of wheel speeds, with the false-discovery rate kept (Benjamini and Hochberg),
of what commands moved less what a reference says. Patterns pool all cells, and so see what no cell alone shows.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from dynreg.timed.cells import Grid, Pieces, mean_by_cell
from dynreg.timed.commands import Commands
from dynreg.timed.patterns import HIGHEST, LOWEST, PATTERNS, Pattern, ranked
from dynreg.timed.reference import Reference
from dynreg.timed.table import DisplacementTable, Rules, rejections

CLEAR = 10.0  # of Schwarz's criterion between two explanations: "very strong" (Kass and Raftery, 1995)
TELLS = 3.0  # standard deviations of one sample by which a command tells two patterns apart
STEP = 0.02  # of a factor, for slopes
FEW_EPISODES = 8  # with fewer of them, drives are split


@dataclass(frozen=True, eq=False)
class Shifts:
    """What moved in every cell: (cells, 3) each, NaN where there was no test.

    value, error : new mean less the old one and its standard error [m, m, rad]. p : of the test. rejected : by the
    rules. pooled : the standard error with the scatter of all cells in place of its own, which few samples tell badly.
    count : (2, cells) samples, old and new.
    """

    value: np.ndarray
    error: np.ndarray
    p: np.ndarray
    rejected: np.ndarray
    pooled: np.ndarray
    count: np.ndarray

    @property
    def sigmas(self) -> np.ndarray:
        """(cells, 3) normal deviates that are as rare as the shifts, with their sign."""
        return np.sign(self.value) * norm.isf(0.5 * np.clip(self.p, 1e-300, 1.0))


@dataclass(frozen=True)
class Judged:
    """One pattern: its factor with a 95 % interval, the share of the squared shifts that it explains, its evidence.

    low, high : within the bounds of the search, all of it where the shifts say nothing of the factor. at_bound : the
    factor stands at one of them. evidence : Schwarz's criterion of no change less its own, with shifts as scattered as
    the best pattern leaves them.
    """

    name: str
    factor: float
    low: float
    high: float
    share: float
    evidence: float
    at_bound: bool = False


@dataclass(frozen=True)
class Split:
    """How often the rules reject in the earlier recording split in two at random.

    tests : on average. one_by_one : share of tests below the level. alarms : share of splits with any alarm, of the
    tests by the rules or of a pattern.
    """

    splits: int
    by: str
    tests: float
    one_by_one: float
    alarms: float


def shifts(old: DisplacementTable, new: DisplacementTable, rules: Rules) -> Shifts:
    """Of new samples against old ones."""
    p, rejected = rejections(old, new, rules)
    (n, mean, deviation), (m, other, spread) = old.moments(), new.moments()
    there = np.isfinite(p)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = (n - 1) * deviation**2 + (m - 1) * spread**2
        own = square / (n + m - 2) * (1 / n + 1 / m)
        error = np.sqrt(deviation**2 / n + spread**2 / m if rules.welch else own)
        of_all = np.where(there, square, 0.0).sum(axis=0) / np.where(there, n + m - 2, 0).sum(axis=0)
        pooled = np.sqrt(of_all * (1 / n + 1 / m))
    value, error, pooled = (np.where(there, x, np.nan) for x in (other - mean, error, pooled))
    return Shifts(value, error, p, rejected, pooled, np.stack([n[:, 0], m[:, 0]]).astype(int))


def explained(found: Shifts, change: Callable[[str, float], np.ndarray]) -> tuple[Judged, ...]:
    """Patterns, the best first, with "no change" among them.

    change : (cells, 3) shifts that a pattern brings with a factor. Where even the best one leaves more than scatter,
    all that they differ by counts for less, by that ratio, and intervals are wider.
    """
    many = int(np.isfinite(found.value).sum())
    if not many:
        return ()
    order = ranked(change, found.value, found.pooled)
    rest = {p.name: p.bic - (p.name != "no change") * np.log(many) for p in order}
    loose = max(1.0, min(rest.values()) / max(many - 1, 1))
    judged = [_judged(p, rest, loose, many) for p in order]
    return tuple(sorted(judged, key=lambda j: -j.evidence))


def _judged(pattern: Pattern, rest: dict[str, float], loose: float, many: int) -> Judged:
    wide = float(norm.isf(0.025)) * pattern.error * np.sqrt(loose)
    gain = (rest["no change"] - rest[pattern.name]) / loose - np.log(many)
    return Judged(
        pattern.name,
        pattern.factor,
        max(float(pattern.factor - wide), LOWEST),
        min(float(pattern.factor + wide), HIGHEST),
        pattern.share,
        0.0 if pattern.name == "no change" else float(gain),
        pattern.at_bound,
    )


def rivals(order: tuple[Judged, ...]) -> tuple[str, ...]:
    """The patterns that explain the shifts: one where it is clear, several that cannot be told apart, or none."""
    if not order or order[0].evidence <= CLEAR:
        return ()
    near = (j.name for j in order if order[0].evidence - j.evidence <= CLEAR)
    return tuple(name for name in near if name != "no change")


def change_by_cell(reference: Reference, new: Pieces, grid: Grid) -> Callable[[str, float], np.ndarray]:
    """What a pattern with a factor moves more in every cell (cells, 3), by the commands of the new pieces."""
    before = reference.predict(new.commands)
    cell = new.cell_of_drive

    def change(pattern: str, factor: float) -> np.ndarray:
        after = reference.changed(pattern, factor).predict(new.commands)
        return mean_by_cell(grid.cells, cell, new.by_drive(after - before))

    return change


def split_against_itself(
    old: Pieces,
    off: np.ndarray,
    grid: Grid,
    reference: Reference,
    rules: Rules,
    splits: int,
    rng: np.random.Generator,
) -> Split | None:
    """The same tests on random halves of the old pieces, with values (n, 3); None where no half can be tested.

    Whole episodes go to one half or the other where there are enough of them, else whole drives do. Patterns are
    looked for along their slopes at no change, which is where they are.
    """
    values, cell = old.by_drive(off), old.cell_of_drive
    still = reference.predict(old.commands)
    slopes = [
        old.by_drive((reference.changed(name, 1.0 + STEP).predict(old.commands) - still) / STEP)
        for name in PATTERNS
    ]
    episodes = np.unique(old.episode)
    whole = len(episodes) >= FEW_EPISODES
    tests, below, alarms = 0, 0, 0
    for _ in range(splits):
        if whole:
            taken = rng.permutation(episodes)[: len(episodes) // 2]
            half = np.isin(old.episode, taken)
        else:
            half = np.zeros(old.drives, dtype=bool)
            half[rng.permutation(old.drives)[: old.drives // 2]] = True
        one, other = (DisplacementTable.of(grid.cells, cell[h], values[h]) for h in (~half, half))
        found = shifts(one, other, rules)
        known = np.isfinite(found.p)
        tests += int(known.sum())
        below += int((found.p[known] < rules.level).sum())
        moves = (mean_by_cell(grid.cells, cell[half], slope[half]) for slope in slopes)
        alarms += bool(found.rejected.any()) or _along(found, moves)
    if not tests:
        return None
    return Split(splits, "episodes" if whole else "commands", tests / splits, below / tests, alarms / splits)


def _along(found: Shifts, slopes: Iterable[np.ndarray]) -> bool:
    """Whether any pattern is clear, by its slopes (cells, 3)."""
    known = np.isfinite(found.value) & (found.pooled > 0)
    scaled, many = found.value[known] / found.pooled[known], int(known.sum())
    if many < 2:
        return False
    gains = []
    for slope in slopes:
        along = slope[known] / found.pooled[known]
        length = float(along @ along)
        gains.append(float(along @ scaled) ** 2 / length if length > 0 else 0.0)
    best = max(gains)
    loose = max(1.0, (float(scaled @ scaled) - best) / (many - 1))
    return best / loose - np.log(many) > CLEAR


def apart_at(
    found: Shifts, order: tuple[Judged, ...], reference: Reference, grid: Grid, sample: float, most: int = 4
) -> tuple[tuple[float, float, float, bool], ...]:
    """Commands that tell the two best patterns apart: left and right [m/s], and by how many standard deviations.

    Of `sample` seconds each, from the same speeds, one in a cell; no two of neighbouring cells. The last says whether
    the cell has old samples to be held against: others are only named where none of these tells them apart.
    """
    names = [j for j in order if j.name != "no change"][:2]
    cells = np.arange(grid.cells)
    left, right = grid.middle(cells).T
    told = Commands(left, right, np.full(len(left), sample), left, right)
    one, other = (reference.changed(j.name, j.factor).predict(told) for j in names)
    scatter = _scatter(found)
    apart = np.sqrt((((other - one) / scatter) ** 2).sum(axis=1))
    known = found.count[0] >= 2
    tells = apart >= TELLS
    allowed = known & tells if (known & tells).any() else tells
    out: list[int] = []
    for at in np.argsort(-np.where(allowed, apart, 0.0), kind="stable")[: int(allowed.sum())]:
        place = np.array(np.divmod(at, grid.each))
        if all(np.abs(place - np.divmod(i, grid.each)).max() > max(1, grid.each // 5) for i in out):
            out.append(int(at))
        if len(out) == most:
            break
    return tuple((float(left[i]), float(right[i]), float(apart[i]), bool(known[i])) for i in out)


def _scatter(found: Shifts) -> np.ndarray:
    """(3,) standard deviation of one sample, over all cells."""
    n, m = found.count
    with np.errstate(divide="ignore", invalid="ignore"):
        one = found.pooled / np.sqrt(1 / n + 1 / m)[:, None]
    out = np.array([np.nanmedian(x) if np.isfinite(x).any() else np.nan for x in one.T])
    return np.where(np.isfinite(out) & (out > 0), out, 1.0)

"""Models of displacements compared: errors by axis, analysis of variance, Tukey's test and a paired one."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from dynreg.errors import SimulationError, UsageError
from dynreg.timed.commands import AXES

UNITS = ("cm", "cm", "deg")
STRETCHES = 10  # of commands in a row that count as independent: neighbouring commands err alike
FACTORS = np.array([100.0, 100.0, np.degrees(1.0)])  # from m and rad


@dataclass(frozen=True)
class Spread:
    """Of absolute errors in `unit`."""

    mean: float
    min: float
    max: float
    sd: float
    unit: str


@dataclass(frozen=True)
class Pair:
    """Two models on one axis: mean error of the first less that of the second, with its 95 % interval (Tukey).

    tukey : p-value for all pairs and independent samples. paired : `paired_chance` of the pair, by Holm.
    """

    axis: str
    first: str
    second: str
    difference: float
    low: float
    high: float
    unit: str
    tukey: float
    paired: float


@dataclass(frozen=True)
class Variance:
    """One-way analysis of variance of the absolute errors on one axis; f is None where it is infinite."""

    axis: str
    f: float | None
    between: int
    within: int
    p: float


@dataclass(frozen=True)
class Errors:
    """Errors {model: {axis: spread}}, the mean absolute displacement of each axis, and the tests.

    seen : the models that may have been fitted to these commands: in no pair, and not the best beside others.
    """

    commands: int
    models: Mapping[str, Mapping[str, Spread]]
    displacements: Mapping[str, float]
    variance: tuple[Variance, ...]
    pairs: tuple[Pair, ...]
    seen: tuple[str, ...] = ()

    @property
    def best(self) -> str:
        """The model with the least error as a share of displacements, over all axes, no `seen` one beside others."""
        size = self.displacements
        share = {
            name: sum(spread.mean / size[axis] for axis, spread in axes.items() if size[axis] > 0)
            for name, axes in self.models.items()
        }
        return min([name for name in share if name not in self.seen] or share, key=share.__getitem__)


def compared(moved: np.ndarray, predicted: Mapping[str, np.ndarray], seen: Collection[str] = ()) -> Errors:
    """How far predictions {model: (n, 3)} are from displacements (n, 3) [m, m, rad].

    Tukey's test takes the errors of the models for independent samples (Pretorius et al.); they are of the same
    commands, so `paired_chance`, corrected by Holm's method, is told beside. Where no model's errors vary on an axis,
    models that are off alike have F = 0 and p = 1, others F = None (infinite) and p = 0. seen : models that may have
    been fitted to the commands, which no test compares with others; the analysis of variance leaves them out where
    two others are left. Raises UsageError for fewer than two models or three commands, SimulationError where a
    prediction is no number.
    """
    if len(predicted) < 2 or len(moved) < 3:
        raise UsageError(
            f"{len(predicted)} models on {len(moved)} commands",
            expected="two models or more, on three commands or more",
            do="name more models, or a longer recording",
        )
    for name, found in predicted.items():
        lost = int((~np.isfinite(found).all(axis=1)).sum())
        if lost:
            raise SimulationError(
                f"model {name!r} diverges on {lost} of {len(moved)} commands",
                expected="a displacement for every command",
                do="leave it out, or fit it to more commands such as these",
            )
    errors = {name: np.abs(p - moved) * FACTORS for name, p in predicted.items()}
    fair = [name for name in errors if name not in seen]
    tested = fair if len(fair) > 1 else list(errors)
    variance, pairs = [], []
    for at, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True)):
        whole, each = judged({name: errors[name][:, at] for name in tested}, axis, unit)
        variance.append(whole)
        pairs += each if tested == fair else []
    return Errors(
        commands=len(moved),
        models={name: dict(zip(AXES, map(spread, e.T, UNITS), strict=True)) for name, e in errors.items()},
        displacements=dict(zip(AXES, map(float, (np.abs(moved) * FACTORS).mean(axis=0)), strict=True)),
        variance=tuple(variance),
        pairs=tuple(pairs),
        seen=tuple(name for name in errors if name in seen),
    )


def judged(errors: Mapping[str, np.ndarray], axis: str, unit: str) -> tuple[Variance, list[Pair]]:
    """The tests of errors {model: (n,)} on one axis, in `unit`."""
    from scipy import stats

    names, columns = list(errors), list(errors.values())
    steady = all(np.ptp(c) == 0.0 for c in columns)
    f, p = _without_scatter(columns) if steady else map(float, stats.f_oneway(*columns))
    within = sum(len(c) - 1 for c in columns)
    whole = Variance(axis=axis, f=f, between=len(columns) - 1, within=within, p=p)
    both = list(combinations(range(len(columns)), 2))
    if steady:
        radius, chances = 0.0, [_without_scatter([columns[a], columns[b]])[1] for a, b in both]
    else:
        radius, chances = _tukey(columns, both)
    paired = holm([paired_chance(columns[a] - columns[b]) for a, b in both])
    pairs = []
    for (a, b), tukey, chance in zip(both, chances, paired, strict=True):
        apart = float(columns[a].mean() - columns[b].mean())
        pairs.append(
            Pair(
                axis=axis,
                first=names[a],
                second=names[b],
                difference=apart,
                low=apart - radius,
                high=apart + radius,
                unit=unit,
                tukey=tukey,
                paired=chance,
            )
        )
    return whole, pairs


def paired_chance(differences: np.ndarray) -> float:
    """The p-value of differences (n,) of two models' errors on commands in their order; 1 where all are 0.

    The larger of two: Wilcoxon's, which takes commands for independent, and Student's of their signed ranks, summed in
    `STRETCHES` stretches of commands in a row. The second holds where what makes neighbouring commands err alike lasts
    much less than a stretch.
    """
    from scipy import stats

    if not differences.any():
        return 1.0
    ranks = np.sign(differences) * stats.rankdata(np.abs(differences))
    means = np.array([one.mean() for one in np.array_split(ranks, min(STRETCHES, len(ranks)))])
    error = means.std(ddof=1) / np.sqrt(len(means))
    apart = abs(means.mean()) / error if error > 0 else np.inf
    return float(max(stats.wilcoxon(differences).pvalue, 2.0 * stats.t.sf(apart, len(means) - 1)))


def _tukey(columns: list[np.ndarray], both: list[tuple[int, int]]) -> tuple[float, list[float]]:
    """Half of the 95 % interval of every difference of means, and the p-value of each pair (Tukey's test).

    columns : (n,) each, of one n. scipy.stats.tukey_hsd says the same, and integrates for each pair twice.
    """
    from scipy import stats

    many, samples = len(columns), len(columns[0])
    within = many * (samples - 1)
    mean_square = sum(c.var(ddof=1) * (samples - 1) for c in columns) / within
    error = float(np.sqrt(mean_square / samples))
    ranges = [abs(columns[a].mean() - columns[b].mean()) / error for a, b in both]
    return _critical_range(many, within) * error, stats.studentized_range.sf(ranges, many, within).tolist()


@cache
def _critical_range(many: int, within: int) -> float:
    """The studentized range that 5 % exceed; kept, for each takes a twentieth of a second or more."""
    from scipy import stats

    return float(stats.studentized_range.ppf(0.95, many, within))


def _without_scatter(columns: list[np.ndarray]) -> tuple[float | None, float]:
    """F and p where no model's errors (n,) vary: 0 and 1 where all are the same, else infinite (None) and 0."""
    return (0.0, 1.0) if len({float(c[0]) for c in columns}) == 1 else (None, 0.0)


def spread(errors: np.ndarray, unit: str) -> Spread:
    """Of absolute errors (n,) in `unit`; without a deviation (0) where there is only one."""
    return Spread(
        mean=float(errors.mean()),
        min=float(errors.min()),
        max=float(errors.max()),
        sd=float(errors.std(ddof=1)) if len(errors) > 1 else 0.0,
        unit=unit,
    )


def holm(chances: list[float]) -> list[float]:
    """p-values that hold for all of them together (Holm, Scand. J. Stat. 6, 1979)."""
    order = np.argsort(chances, kind="stable")
    out, least = np.empty(len(chances)), 0.0
    for rank, at in enumerate(order):
        least = max(least, min(1.0, (len(chances) - rank) * chances[at]))
        out[at] = least
    return out.tolist()

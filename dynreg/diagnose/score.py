"""Score: by how much each hypothesis beats the model without its last term, and which are as good as the best."""

from dataclasses import dataclass, field

import numpy as np

from dynreg.diagnose.hypothesis import worth_naming
from dynreg.diagnose.problem import Point, Problem, log_likelihood, mean_squares

PER_PARAMETER = 2.0  # nats that a parameter of an effect must pay for itself
NEAR = 0.05  # share of the best score, but at least
FEW = 3.0  # nats, within which fewer parameters are the better explanation;
BEYOND = 5.0  # nats that fit may gain beyond twice what select gains: more is fitted noise
NATS = 15.0  # nats (or that share) within which hypotheses count as equal


@dataclass(frozen=True)
class Scored:
    """A fitted hypothesis: its point, and by how many nats it beats the model without its last term."""

    point: Point
    nats: float

    @property
    def key(self) -> str:
        return self.point.hypothesis.key


@dataclass
class Naming:
    """One round: the calibrated model that it started from, the ranking, and what was chosen.

    improved : whether the start turned out better than the calibration that the round began with.
    """

    start: Scored
    ranking: list[Scored]
    chosen: Scored | None = None
    equivalent: list[Scored] = field(default_factory=list)
    improved: bool = False


def select(
    problem: Problem,
    base: Point,
    fitted: list[Point],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    *,
    together: bool = False,
) -> Naming:
    """Score on all windows, drop what is below half its weak size, prefer fewer parameters among equals.

    What a term gains where it was fitted counts only as far as the windows to select by confirm it.
    together : all were fitted on all windows, and nothing confirms anything: the threshold alone tells chance.
    """
    windows = np.concatenate([fit_on, select_on])
    everything = problem.residuals([base, *fitted], windows)
    squares = mean_squares(everything, problem.floor)
    if together:
        likelihood = by_either(problem, everything, squares)
    else:
        rough = np.array([np.nansum(np.log(s)) for s in squares])
        effective = problem.effective(everything[int(rough.argmin())])
        many = len(fit_on) * problem.segments
        gained = [log_likelihood(squares[:, w], effective[w]) for w in (slice(None, many), slice(many, None))]
        on_fit, on_select = (g - g[0] for g in gained)
        likelihood = np.minimum(on_fit, 2.0 * np.maximum(on_select, 0.0) + BEYOND) + on_select
    start = Scored(base, 0.0)
    best: dict[str, Scored] = {}
    for i, point in enumerate(fitted, start=1):
        more = len(point.effect) - len(base.effect)
        nats = likelihood[i] - PER_PARAMETER * more - (point.penalty - base.penalty)
        if not worth_naming(point.hypothesis, point.effect):
            continue
        scored = Scored(point, float(nats))
        if scored.key not in best or best[scored.key].nats < scored.nats:
            best[scored.key] = scored
    ranking = sorted(best.values(), key=lambda s: -s.nats)
    naming = Naming(start, ranking)
    if ranking and ranking[0].nats > 0:
        top = ranking[0].nats
        near = [s for s in ranking if s.nats >= top - max(NEAR * top, FEW)]
        naming.chosen = min(near, key=lambda s: (len(s.point.effect), -s.nats))
        within = max(NEAR * top, NATS)
        naming.equivalent = [s for s in ranking if s.nats >= top - within and s is not naming.chosen]
    return naming


def by_either(problem: Problem, residuals: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """(n,) what each gains on the first, by the independent samples of its own residual or of the first's.

    The less of both: where every window slips on its own, which of them count for more makes up gains of 100 nats.
    """
    samples = [problem.effective(r) for r in residuals]
    gains = []
    for square, own in zip(squares, samples, strict=True):
        pair = np.stack([squares[0], square])
        gains.append(min(float(np.diff(log_likelihood(pair, e))[0]) for e in (samples[0], own)))
    return np.array(gains)

"""Simulators that a recording leaves open: draws of parameters whose replays err about as little as the answer's.

Rejection sampling without a likelihood (approximate Bayesian computation, Pritchard et al. 1999). The draws come from
the posterior of a linear model of the residuals (`intervals`), wider and narrower. Each is judged by its own replay. So
parameters of which the recording tells nothing keep the width of their ranges, and those that make up for each other
move together.
"""

import numpy as np

from dynreg.neighbours.query import Case, Choice, regressed
from dynreg.replay.windows import errors
from dynreg.rng import stream

# Of the linear model's deviations. It is too sure where contacts make residuals wild, and not sure enough where every
# draw errs more than the answer does.
WIDTHS = (1.5, 1.0, 0.5, 0.25)
EACH = 48  # draws of every width
# Times the answer's error, up to which a draw will do: an answer also fits the noise. The true simulators of twelve
# quadrupeds erred 0.83 to 1.15 times as much as the answers of their queries (`truth` in bench_gait_ways).
TOLERANCE = 1.15


def drawn(case: Case, chosen: Choice, many: int, seed: int) -> np.ndarray:
    """(m, P) values of the answer, and of draws that the recording does not tell from it, the widest first.

    m is at most `many`, and 1 where no draw replays the recording as well. Known parameters stay.
    """
    replays, answer = chosen.replays, chosen.replays.unit[chosen.answer]
    _, found = regressed(replays, answer, case.data.values_of)
    covariance = found.correlations * np.outer(found.deviations, found.deviations)
    none = np.zeros(len(covariance))
    moves = stream(seed, "posterior draws").multivariate_normal(
        none, covariance, EACH * len(WIDTHS), check_valid="ignore", method="eigh"
    )
    unit = np.tile(answer, (len(moves), 1))
    free = np.flatnonzero(replays.free)
    unit[:, free] = _folded(unit[:, free] + moves * np.repeat(WIDTHS, EACH)[:, None])
    values = case.data.values_of(np.concatenate([answer[None], unit]))
    error = errors(case.replayer.residuals(values, case.data.parts.chosen)).mean(axis=1)
    alike = np.flatnonzero(error[1:] <= TOLERANCE * error.min()) + 1
    return values[[0, *alike[: many - 1]]]


def _folded(unit: np.ndarray) -> np.ndarray:
    """Back into the unit cube, as by mirrors at its sides: no draw is piled up on an edge."""
    back = np.abs(unit) % 2.0
    return np.where(back > 1.0, 2.0 - back, back)

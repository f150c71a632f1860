"""Simulators that a recording leaves open: draws of parameters whose replays err about as little as the answer's.

Rejection sampling without a likelihood (approximate Bayesian computation, Pritchard et al. 1999). The draws come from
the posterior of a linear model of the residuals (`intervals`), wider and narrower. Each is judged by its own replay. So
parameters of which the recording tells nothing keep the width of their ranges, and those that make up for each other
move together. The motor noise is drawn, too, for replays run without it.

The widest that replay as well are taken. They are no fair sample of the posterior: they are the outermost parameters
that still fit.
Replays begin at the measured start states, with their errors. These are in all errors alike, so the noisier the start
states, the more draws will do: the safer side.
"""

import numpy as np

from dynreg.evidence.lockstep import one_blas_thread
from dynreg.neighbours.query import Case, Choice, regressed
from dynreg.replay.windows import errors
from dynreg.rng import stream

# Of the linear model's deviations. It is too sure where contacts make residuals wild, and not sure enough where every
# draw errs more than the answer does.
WIDTHS = (1.5, 1.0, 0.5, 0.25)
# Draws of every width: of most of 24 quadrupeds all 16 simulators could be taken of them, of one two.
EACH = 48
# Times the least error, of the answer or of a draw, up to which a draw will do: an answer also fits the noise. The true
# simulators of twelve quadrupeds of the development erred 0.83 to 1.15 times as much as the answers of their queries;
# bench_gait_ways prints it of others.
TOLERANCE = 1.15


@one_blas_thread()
def drawn(case: Case, chosen: Choice, many: int, seed: int) -> np.ndarray:
    """(m, P) values of the answer, and of draws that the recording cannot tell apart from it, the widest first.

    m is at most `many`, and 1 where no draw replays the recording as well. Known parameters stay.
    """
    replays, answer = chosen.replays, chosen.replays.unit[chosen.answer]
    _, found = regressed(replays, answer, case.data.values_of)
    covariance = found.correlations * np.outer(found.deviations, found.deviations)
    free, rng = np.flatnonzero(replays.free), stream(seed, "posterior draws")
    moves = rng.multivariate_normal(
        np.zeros(len(free)), covariance, (len(WIDTHS), EACH), check_valid="ignore", method="eigh"
    )
    unit = np.tile(answer, (len(WIDTHS), EACH, 1))
    unit[..., free] = _folded(answer[free] + np.array(WIDTHS)[:, None, None] * moves)
    values = [answer[None], *unit]
    error = np.concatenate([_errors(case, one, stage) for stage, one in enumerate(values)])
    alike = np.flatnonzero(error[1:] <= TOLERANCE * error.min()) + 1
    return case.data.values_of(np.concatenate(values)[[0, *alike[: many - 1]]])


def _errors(case: Case, unit: np.ndarray, stage: int) -> np.ndarray:
    """(n,) errors of unit parameters (n, P) from the measured start states."""
    found = case.replayer.residuals(case.data.values_of(unit), case.data.parts.chosen)
    case.report("draw", stage, len(WIDTHS))
    return errors(found).mean(axis=1)


def _folded(unit: np.ndarray) -> np.ndarray:
    """Back into the unit cube, as by mirrors at its sides: no draw is piled up on an edge."""
    back = np.abs(unit) % 2.0
    return np.where(back > 1.0, 2.0 - back, back)

"""Three networks of 20 sigmoid neurons, one for each axis of the displacement, by Levenberg and Marquardt's method.

Pretorius et al.: inputs are the command, the one before and its time; training ends after ten rises of the validation
error in a row; of 30 random starts the one with the lowest validation error is kept.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.timed.commands import AXES, Commands

HIDDEN = 20
WEIGHTS = 7 * HIDDEN + 1  # of one network with five inputs
RISES = 10  # of the validation error in a row
STARTS = 30
ITERATIONS = 500  # at most
SPREAD = 0.5  # 1 sigma of a weight at the start
Part = tuple[np.ndarray, np.ndarray]
STILL = 1e-6  # a column whose spread is below this share of its size carries rounding, not information


@dataclass(frozen=True, eq=False)
class Networks:
    """Three networks 5-20-1: weights (3, 141) for standardised inputs and outputs.

    mean, scale : (5,) of the inputs. out_mean, out_scale : (3,) of the displacements.
    errors : (3,) mean squared validation error of each, in units of the displacements' variance.
    """

    weights: np.ndarray
    mean: np.ndarray
    scale: np.ndarray
    out_mean: np.ndarray
    out_scale: np.ndarray
    errors: np.ndarray

    def predict(self, commands: Commands) -> np.ndarray:
        """(n, 3) displacements."""
        inputs = (commands.table - self.mean) / self.scale
        out = np.stack([_out(w, inputs)[0] for w in self.weights], axis=1)
        return self.out_mean + self.out_scale * out


def train(
    commands: Commands,
    moved: np.ndarray,
    validation: tuple[Commands, np.ndarray],
    *,
    starts: int = STARTS,
    seed: int = 0,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Networks:
    """Networks of commands (n,) and displacements (n, 3); `validation` is the same of others.

    workers : processes that train side by side, 0 for none but this one; they do the same. The last bits of MINPACK's
    steps differ from run to run, whatever the seed and the workers, and a long training makes them larger. progress :
    called with starts done and all of them. Raises UsageError where there are fewer commands than weights of a network.
    """
    if len(commands) < WEIGHTS:
        raise UsageError(
            f"{len(commands)} commands to train networks of {WEIGHTS} weights",
            expected=f"at least {WEIGHTS}",
            do="record more commands",
        )
    inputs, targets = commands.table, moved
    (mean, scale), (out_mean, out_scale) = scales(inputs), scales(targets)
    known = (inputs - mean) / scale, (targets - out_mean) / out_scale
    unseen = (validation[0].table - mean) / scale, (validation[1] - out_mean) / out_scale
    jobs = [(axis, start) for axis in range(len(AXES)) for start in range(starts)]
    answers = _answers(known, unseen, jobs, seed, min(workers, len(jobs)))
    best: dict[int, tuple[np.ndarray, float]] = {}
    for done, ((axis, _), found) in enumerate(zip(jobs, answers, strict=True)):
        if axis not in best or found[1] < best[axis][1]:
            best[axis] = found
        if progress:
            progress(done + 1, len(jobs))
    weights, errors = zip(*(best[axis] for axis in range(len(AXES))), strict=True)
    return Networks(np.array(weights), mean, scale, out_mean, out_scale, np.array(errors))


def _answers(
    known: Part, unseen: Part, jobs: Sequence[tuple[int, int]], seed: int, workers: int
) -> Iterable[tuple[np.ndarray, float]]:
    """What `trained` says of each job, in their order.

    MINPACK never lets go of Python's lock, so threads would not help. scikit-learn's processes do not run the caller's
    script again, as those of the standard library do where it has no main guard.
    """
    along = [[(inputs, moved[:, axis]) for inputs, moved in (known, unseen)] for axis in range(len(AXES))]
    asked = [(seed, axis, start, *along[axis]) for axis, start in jobs]
    if workers < 2:
        return (trained(*one) for one in asked)
    from sklearn.utils.parallel import Parallel, delayed

    return Parallel(n_jobs=workers, backend="loky", return_as="generator")(
        delayed(trained)(*one) for one in asked
    )


def scales(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C,) mean and standard deviation of columns (n, C); deviation 1 where a column does not change."""
    mean, scale = table.mean(axis=0), table.std(axis=0)
    return mean, np.where(scale > STILL * np.maximum(np.abs(mean), STILL), scale, 1.0)


def trained(seed: int, axis: int, start: int, known: Part, unseen: Part) -> tuple[np.ndarray, float]:
    """Weights (141,) of the network of an axis with the lowest validation error on the way from a start; that error.

    known, unseen : standardised inputs (n, 5) and displacements (n,) along the axis.
    """
    from scipy.optimize import least_squares

    first = SPREAD * stream(seed, "networks", AXES[axis], start).standard_normal(WEIGHTS)
    best, last, rises = (first, np.inf), np.inf, 0

    def slopes(weights: np.ndarray) -> np.ndarray:
        """MINPACK asks for them once for every step that it took: there the validation is watched."""
        nonlocal best, last, rises
        error = float(np.mean((_out(weights, unseen[0])[0] - unseen[1]) ** 2))
        rises = rises + 1 if error > last else 0
        last = error
        if error < best[1]:
            best = (weights.copy(), error)
        if rises >= RISES:
            raise _Enough
        return _slopes(weights, known[0])

    try:
        least_squares(
            lambda w: _out(w, known[0])[0] - known[1], first, jac=slopes, method="lm", max_nfev=ITERATIONS
        )
    except _Enough:
        pass
    return best


class _Enough(Exception):
    """The validation error rose ten times in a row."""


def _out(weights: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) outputs and (n, H) activities for inputs (n, I)."""
    into, bias, out = _parts(weights, inputs.shape[1])
    active = 0.5 + 0.5 * np.tanh(0.5 * (inputs @ into + bias))  # the sigmoid, five times as quick as SciPy's
    return active @ out + weights[-1], active


def _slopes(weights: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """(n, 141) derivatives of the outputs."""
    out = _parts(weights, inputs.shape[1])[2]
    active = _out(weights, inputs)[1]
    slope = active * (1.0 - active) * out
    into = (inputs[:, :, None] * slope[:, None]).reshape(len(inputs), -1)
    return np.concatenate([into, slope, active, np.ones((len(inputs), 1))], axis=1)


def _parts(weights: np.ndarray, inputs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    at = inputs * HIDDEN
    return weights[:at].reshape(inputs, HIDDEN), weights[at : at + HIDDEN], weights[at + HIDDEN : -1]

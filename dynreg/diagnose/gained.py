"""What simulators leave of the motion on the windows that a diagnosis is judged by, and what its causes take off."""

import numpy as np

from dynreg.diagnose.problem import Problem
from dynreg.replay import judged as replayed
from dynreg.replay.judged import Gain
from dynreg.replay.residual import scaled


def gain(problem: Problem, before: np.ndarray, after: np.ndarray, judged: np.ndarray) -> Gain | None:
    """Share of the error that `after` takes off `before`, states (W, T+1, S) of the windows `judged`."""
    return replayed.gain(*(window_errors(problem, states, judged) for states in (before, after)))


def window_errors(problem: Problem, states: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """(W,) weighted mean absolute error of states (W, T+1, S), in units of the channels' spread."""
    use = problem.use
    measured = problem.windows.measured[judged][:, 1:, use]
    each = np.nanmean(np.abs(scaled(states[:, 1:, use], measured, problem.windows.spread[use])), axis=1)
    return np.nansum(each * problem.windows.weight[use], axis=1)


def channel_errors(problem: Problem, states: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """(n, C) mean absolute error of states (n, W, T+1, S) in every weighted channel, in its unit."""
    out = []
    for column in problem.use:
        miss = np.abs(states[:, :, 1:, column] - problem.windows.measured[judged][:, 1:, column])
        out.append([np.nanmean(np.where(np.isfinite(m), m, np.nan)) for m in miss])
    return np.array(out).T

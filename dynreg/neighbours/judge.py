"""Judge the answer of a query: its error relative to the spread of the nearest neighbours."""

import numpy as np

TOO_FAR = (
    3.0  # ratio of the answer's error to the nearest neighbours' own spread, above which the alarm is raised
)


def misfit(residuals: np.ndarray, error: float) -> float:
    """The answer's error over what separates neighbouring simulators with residuals (n, W, T, S).

    Each neighbour is taken for the robot in turn: how far is its nearest fellow, under these very commands?
    A robot of the family is about as far from its nearest neighbour as they are from theirs.
    """
    flat = residuals.reshape(len(residuals), -1).astype(float)
    apart = np.array([np.nanmean(np.abs(flat - one), axis=1) for one in flat])
    np.fill_diagonal(apart, np.inf)
    usual = float(np.median(apart.min(axis=1)))
    return error / max(usual, 1e-12)

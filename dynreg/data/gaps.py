"""Where a signal is silent for longer than it usually is: no straight line may stand for what happened there."""

import numpy as np

BRIDGED = 0.15  # s: shorter silences are filled in, a lost message or two say little
USUAL = 3.0  # times the signal's usual interval: a slow sensor is not silent between its samples


def silences(time: np.ndarray) -> np.ndarray:
    """(G, 2) begin and end [s] of what is too long to be filled in, of a signal with numbers at the stamps (T,).

    >>> silences(np.array([0.0, 0.01, 0.02, 0.52, 0.53]))
    array([[0.02, 0.52]])
    """
    steps = np.diff(time)
    if not len(steps):
        return np.empty((0, 2))
    long = np.flatnonzero(steps > max(BRIDGED, USUAL * float(np.median(steps))))
    return np.stack([time[long], time[long + 1]], axis=1)

"""Gaps: spans in which a signal is silent for longer than usual, and must not be interpolated."""

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


def silent(known: np.ndarray, time: np.ndarray, nothing: np.ndarray | None = None) -> np.ndarray:
    """(T,) whether `time` [s] lies within a silence of the stamps `known`.

    nothing : stamps at which the signal was logged, but held no number: only silences with some in them count.
    """
    out = np.zeros(len(time), dtype=bool)
    for begin, end in silences(known):
        if nothing is None or ((nothing > begin) & (nothing < end)).any():
            out |= (time > begin) & (time < end)
    return out

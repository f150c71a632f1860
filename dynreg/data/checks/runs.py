"""The longest run of True in an array."""

import numpy as np


def longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Start and length of the longest run of True.

    >>> longest_run(np.array([False, True, True, False, True]))
    (1, 2)
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if not len(edges):
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    best = int(np.argmax(lengths))
    return int(edges[2 * best]), int(lengths[best])

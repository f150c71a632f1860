"""Single samples that are far from both their neighbours."""

import numpy as np

BESIDE = 5  # samples on each side that tell what the signal does there
TIMES = 10.0  # a spike's height over the most that the signal bends beside it
STEPS = 5.0  # its least height in steps of the sensor
SHARE = 0.02  # its least height as a share of the range of 98 % of the signal


def bends(values: np.ndarray) -> np.ndarray:
    """(T,) how far each value lies from the middle of its neighbours; 0 at the ends and beside NaN."""
    out = np.zeros(len(values))
    if len(values) > 2:
        out[1:-1] = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    return np.nan_to_num(out, nan=0.0, posinf=0.0, neginf=0.0)


def spikes(values: np.ndarray) -> np.ndarray:
    """(K,) rows of single-sample spikes of a signal (T,).

    A spike stands out from both neighbours to the same side, by `TIMES` the bends of the `BESIDE` samples on each side
    and by more than the sensor's steps explain. Steps, ramps, oscillations and noise are none.
    """
    good = np.flatnonzero(np.isfinite(values))
    if len(good) < 4 * BESIDE:
        return np.empty(0, dtype=int)
    v = values[good]
    bend = bends(v)
    height = np.abs(bend)
    before, after = np.append(0.0, np.diff(v)), np.append(np.diff(v), 0.0)
    alone = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > 0.7 * height)
    rows = np.flatnonzero(alone & (height > _least(v)))
    return good[[row for row in rows.tolist() if height[row] > TIMES * _beside(height, row)]].astype(int)


def far_from_median(values: np.ndarray, limit: float) -> np.ndarray:
    """(K,) rows further than `limit` from the median of the five values about them (T,), NaN left out."""
    good = np.flatnonzero(np.isfinite(values))
    if len(good) < 3:
        return np.empty(0, dtype=int)
    about = np.lib.stride_tricks.sliding_window_view(np.pad(values[good], 2, mode="edge"), 5)
    return good[np.abs(values[good] - np.median(about, axis=1)) > limit]


def _least(values: np.ndarray) -> float:
    """The height below which nothing is a spike."""
    low, high = np.quantile(values, [0.01, 0.99])
    steps = np.abs(np.diff(values))
    steps = np.sort(steps[steps > 0])
    quantum = float(steps[len(steps) // 10]) if len(steps) > 4 else 0.0  # a spike's own steps are few
    return max(STEPS * quantum, SHARE * float(high - low), 1e-3 * abs(float(np.median(values))))


def _beside(height: np.ndarray, row: int) -> float:
    """The most that the signal bends near a row, itself and what it does to its neighbours left out."""
    near = np.concatenate([height[max(row - 1 - BESIDE, 0) : row - 1], height[row + 2 : row + 2 + BESIDE]])
    return float(near.max(initial=0.0))

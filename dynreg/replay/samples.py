"""How many independent samples residuals hold: rows over the time for which they stay alike.

There are two rules. The likelihood of a diagnosis takes `effective_samples`: a usual time of each channel, which few
rows or the noise in the tail of the correlations must not move. The Laplace intervals of a query take
`samples_in_all`, one number that every series adds to by its own time, tail and all: a longer time means wider
intervals, the safer error.
"""

import warnings

import numpy as np

FADED, ROWS = (
    0.05,
    8,
)  # a diagnosis: correlation from which on all is noise; measured rows that tell a time, at least
FADED_IN_ALL, ROWS_IN_ALL = 0.0, 4  # a query: the same, so that all of a correlation above none counts


def correlation_time(series: np.ndarray, below: float = FADED, mean: float | None = None) -> float:
    """Integrated autocorrelation time [samples] of (T,) without gaps: 1 + 2 sum of the correlations, 1 for white noise.

    The sum ends with the first lag whose correlation is `below`, where noise takes over. Never below 1: a series that
    alternates does not count as more samples than it has. mean : about which it varies, None for its own.
    """
    x = series - (series.mean() if mean is None else mean)
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    correlation = np.fft.irfft(power)[: len(x)] / max(x @ x, 1e-300)
    until = int(np.argmax(correlation < below)) or len(x)
    return float(max(2.0 * correlation[:until].sum() - 1.0, 1.0))


def effective_samples(residuals: np.ndarray, *, apart: bool = False) -> np.ndarray:
    """(W, C) independent samples in residuals (W, T, C): rows over the autocorrelation time.

    That time is the median over the windows: a window that happens to be fitted down to white noise must not count
    for more, or the next fit would do nothing but fit it better still. apart : a window with a longer time of its own
    counts for less: many joints creep, slide or fall where others hold still.
    """
    windows, _, channels = residuals.shape
    out, measured = np.full((windows, channels), np.nan), np.zeros((windows, channels))
    for w in range(windows):
        for c in range(channels):
            x = residuals[w, :, c]
            x = x[np.isfinite(x)]
            measured[w, c] = len(x)
            if len(x) >= ROWS and np.any(x):
                out[w, c] = correlation_time(x)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel that nowhere moves
        usual = np.nanmedian(out, axis=0)
    usual = np.where(np.isfinite(usual), usual, np.inf)
    return measured / (np.fmax(out, usual) if apart else usual)


def samples_in_all(residuals: np.ndarray) -> float:
    """Independent samples in residuals (W, T, C), each window and channel by its own time; at least 1."""
    count = 0.0
    for series in np.moveaxis(np.asarray(residuals, dtype=float), 1, 2).reshape(-1, residuals.shape[1]):
        x = series[~np.isnan(series)]
        if len(x) >= ROWS_IN_ALL and np.any(x - x.mean()):
            count += len(x) / correlation_time(x, below=FADED_IN_ALL)
    return max(count, 1.0)

"""The rate of a logged signal, for channels that a log does not hold."""

import numpy as np

from dynreg.data.gaps import silent
from dynreg.data.series import Series, clean
from dynreg.errors import LogError
from dynreg.limits import limits

FILTER_ORDER = 2
GRID_LIMIT = 200_000  # rows; beyond it a grid far denser than the log is taken for a clock that is wrong


def derivative(series: Series, filter_hz: float | None) -> Series:
    """Rate of change of a signal: zero-phase Butterworth low-pass, then central differences.

    The filter (order 2, run forwards and backwards: order 4 and no lag) acts on a uniform grid at the median period, so
    irregular stamps are first interpolated. Rows without a finite value are left out, and of equal stamps all rows but
    the last. Where the signal is silent for longer than can be filled in (`gaps.silences`) there is no rate: NaN.
    Raises LogError where `filter_hz` is not below half the sampling rate.
    """
    nothing = np.unique(series.time[~np.isfinite(series.values)])
    series = clean(series)
    time, values = series.time, series.values
    if len(time) < 3:
        return Series(time, np.full(len(time), np.nan), series.unit)
    if filter_hz is None:
        empty = nothing[silent(time, nothing)]
        slope = np.concatenate([np.gradient(values, time), np.full(len(empty), np.nan)])
        every = np.concatenate([time, empty])
        order = np.argsort(every, kind="stable")
        return Series(every[order], slope[order], series.unit)
    period = float(np.median(np.diff(time)))
    if filter_hz >= 0.5 / period:
        raise LogError(
            f"filter_hz = {filter_hz:g} for a signal sampled at {1 / period:.4g} Hz",
            expected=f"less than {0.5 / period:.4g} Hz",
            do="lower filter_hz in the map, or correct time_unit there if the signal is sampled at another rate",
        )
    rows = int((time[-1] - time[0]) / period + 1e-6) + 1
    if rows > max(GRID_LIMIT, 200 * len(time)) or rows > limits().rows:
        raise LogError(
            f"{len(time)} samples {period:.3g} s apart are spread over {time[-1] - time[0]:.3g} s",
            expected="a clock without leaps",
            do='mend it, or split there with by = "gaps" under [episodes]',
        )
    grid = time[0] + period * np.arange(rows)
    smooth = _smooth(np.interp(grid, time, values), filter_hz, period)
    slope = np.where(silent(time, grid), np.nan, np.gradient(smooth, period))
    return Series(grid, slope, series.unit)


def _smooth(values: np.ndarray, filter_hz: float, period: float) -> np.ndarray:
    """Values (T,) on a grid of `period` [s], low-passed forwards and backwards; LogError where that cannot be done."""
    from scipy.signal import butter, sosfiltfilt

    try:
        return sosfiltfilt(
            butter(FILTER_ORDER, filter_hz, fs=1.0 / period, output="sos"),
            values,
            padlen=min(3 * (FILTER_ORDER + 1), len(values) - 1),
        )
    except ValueError:  # of which LinAlgError is one
        raise LogError(
            f"filter_hz = {filter_hz:g} is too slow for a signal sampled at {1 / period:.4g} Hz",
            expected="a cut-off nearer to that",
            do="raise filter_hz in the map",
        ) from None

"""The rate of a logged signal, for channels that a log does not hold."""

import numpy as np

from dynreg.data.gaps import silent
from dynreg.data.series import Series, clean
from dynreg.errors import LogError
from dynreg.limits import limits

FILTER_ORDER = 2
GRID_LIMIT = 200_000  # rows; beyond it a grid far denser than the log is taken for a clock that is wrong
# A rate is in doubt where the filter takes away more than this many times its noise, and this share of the usual rate.
# Of an arm whose commands step (examples/my_arm.py with dry friction) that leaves out 8 % of the rows; the others are
# off by 0.04 rad/s, all of them by 0.3.
DOUBTED = 6.0
MATTERS = 0.05
MOST = 0.5  # share of the rows in doubt from which on it is the filter that is wrong


def derivative(series: Series, filter_hz: float | None) -> Series:
    """Rate of change of a signal: zero-phase Butterworth low-pass, then central differences.

    The filter (order 2, run forwards and backwards: order 4 and no lag) acts on a uniform grid at the median period, so
    irregular stamps are first interpolated. Rows without a finite value are left out, and of equal stamps all rows but
    the last. Where the signal is silent for longer than can be filled in (`gaps.silences`) there is no rate: NaN. Nor
    is there one where the signal turns too sharply for the filter, or for differences: a replay that began there would
    begin too fast, or too slow. Where that is most of the signal the filter is wrong, and the rates stay. `error` is
    1 sigma of what the filter took away from those that are told.
    Raises LogError where `filter_hz` is not below half the sampling rate.
    """
    nothing = np.unique(series.time[~np.isfinite(series.values)])
    series = clean(series)
    time, values = series.time, series.values
    if len(time) < 3:
        return Series(time, np.full(len(time), np.nan), series.unit, error=0.0)
    period = float(np.median(np.diff(time)))
    if filter_hz is None:
        empty = nothing[silent(time, nothing)]
        slope, error = _trusted(time, values, None, period)
        slope = np.concatenate([slope, np.full(len(empty), np.nan)])
        every = np.concatenate([time, empty])
        order = np.argsort(every, kind="stable")
        return Series(every[order], slope[order], series.unit, error)
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
    even = np.interp(grid, time, values)
    smooth = np.gradient(_smooth(even, filter_hz, period), period)
    slope, error = _trusted(grid, even, smooth, period)
    return Series(grid, np.where(silent(time, grid), np.nan, slope), series.unit, error)


def _trusted(
    time: np.ndarray, values: np.ndarray, smooth: np.ndarray | None, period: float
) -> tuple[np.ndarray, float]:
    """The rate (T,) of `values`, NaN where it is in doubt, and 1 sigma of what was taken away from it elsewhere.

    smooth : the rate to trust. None trusts differences, which are then held against their mean of three rows.
    """
    rough = np.gradient(values, time)
    third = np.diff(values, 3) / np.sqrt(20.0)  # of which noise alone is left
    noise = 1.4826 * np.median(np.abs(third)) / (np.sqrt(2.0) * period) if len(third) else 0.0
    rate = rough if smooth is None else smooth
    away = _of_three(time, rough, period) if smooth is None else rough - smooth
    doubted = np.abs(away) > max(DOUBTED * noise, MATTERS * np.sqrt(np.mean(rate**2)))
    doubted = (
        np.convolve(doubted, np.ones(3), "same") > 0
    )  # where it leaps, both rates are the mean of both sides
    doubted &= doubted.mean() < MOST
    return np.where(doubted, np.nan, rate), float(np.sqrt(np.mean(away[~doubted] ** 2)))


def _of_three(time: np.ndarray, rate: np.ndarray, period: float) -> np.ndarray:
    """(T,) by how much rates differ from those beside them, which count half; 0 where a row beside one is missing."""
    out = np.zeros(len(rate))
    out[1:-1] = 0.5 * rate[1:-1] - 0.25 * (rate[:-2] + rate[2:])
    uneven = np.diff(time) > 1.5 * period
    out[1:-1][uneven[:-1] | uneven[1:]] = 0.0
    return out


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

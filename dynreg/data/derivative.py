"""The rate of a logged signal, for channels that a log does not hold."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.data.gaps import silent
from dynreg.data.series import Series, clean
from dynreg.errors import LogError
from dynreg.limits import limits

FILTER_ORDER = 2
GRID_LIMIT = 200_000  # rows; beyond it a grid far denser than the log is taken for a clock that is wrong
# A rate is in doubt where the filter takes away more than this many times its noise, and this share of the usual rate.
# Of six arms whose commands step (examples/my_arm.py with dry friction) that leaves out 11 % of the rows; the others
# are off by 0.03 rad/s, all of them by 0.37.
DOUBTED = 6.0
MATTERS = 0.05
EQUAL = 1e-9  # of the largest value: a smaller step is none, but an error of rounding
SURE = 1.3  # times the variance of noise that the filter takes away, beyond which it took motion, too
MOST = 0.5  # share of the rows in doubt from which on it is the filter that is wrong


def derivative(series: Series, filter_hz: float | None) -> Series:
    """Rate of change of a signal: zero-phase Butterworth low-pass, then central differences.

    The filter (order 2, run forwards and backwards: order 4 and no lag) acts on a uniform grid at the median period, so
    irregular stamps are first interpolated. Rows without a finite value are left out, and of equal stamps all rows but
    the last. Where the signal is silent for longer than can be filled in (`gaps.silences`) there is no rate: NaN. Nor
    is there one where the signal turns too sharply for the filter, or for differences: a replay that began there would
    begin too fast, or too slow. Where that is most of the signal the filter is wrong, and the rates stay. `error` is
    1 sigma of that of the rates that are told: the noise that the filter leaves, and the motion that it takes away, as
    far as differences show it. Beside sharp turns these miss it too: of an arm whose commands step, `error` is 0.01
    rad/s, and the rates are off by 0.03.
    Raises LogError where `filter_hz` is not below half the sampling rate.
    """
    nothing = np.unique(series.time[~np.isfinite(series.values)])
    series = clean(series)
    time, values = series.time, series.values
    if len(time) < 3:
        return Series(time, np.full(len(time), np.nan), series.unit, error=np.nan)
    period = float(np.median(np.diff(time)))
    if filter_hz is None:
        empty = nothing[silent(time, nothing)]
        rough = np.gradient(values, time)
        found = _Rate(values, rough, _of_three(time, rough, period), period)
        slope = np.concatenate([found.trusted, np.full(len(empty), np.nan)])
        every = np.concatenate([time, empty])
        order = np.argsort(every, kind="stable")
        return Series(every[order], slope[order], series.unit, found.error)
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
    logged = ~silent(time, grid)  # the other rows are made up
    away = np.gradient(even, period) - smooth
    found = _Rate(even[logged], smooth[logged], away[logged], period, _noise_gain(filter_hz, period))
    slope = np.full(len(grid), np.nan)
    slope[logged] = found.trusted
    return Series(grid, slope, series.unit, found.error)


@dataclass(frozen=True, eq=False)
class _Rate:
    """The rate (T,) of `values` (T,) that are `period` [s] apart, and how well it is known.

    away : (T,) what the rate lacks of differences, or of its own neighbours. gain : noise of the rate for each unit of
    noise of the values [1/s]; None for that of differences.
    """

    values: np.ndarray
    rate: np.ndarray
    away: np.ndarray
    period: float
    gain: float | None = None

    @cached_property
    def noise(self) -> float:
        """1 sigma of the noise of the values, by third differences; no less than that of an encoder's steps."""
        if len(self.values) < 4:
            return 0.0
        steps = np.abs(np.diff(self.values))
        steps = steps[steps > EQUAL * np.abs(self.values).max()]
        rounded = len(steps) and 2 * len(np.unique(np.round(self.values, 12))) <= len(self.values)
        step = np.percentile(steps, 1) if rounded else 0.0
        third = np.median(np.abs(np.diff(self.values, 3)))
        return float(max(1.4826 * third / np.sqrt(20.0), step / np.sqrt(12.0)))

    @property
    def rough(self) -> float:
        """1 sigma of the noise of differences over two rows."""
        return self.noise * np.sqrt(0.5) / self.period

    @cached_property
    def doubted(self) -> np.ndarray:
        """(T,) where more is missing than noise explains; nowhere, if that is most of the rows."""
        usual = np.sqrt(np.mean(self.rate**2)) if len(self.rate) else 0.0
        far = np.abs(self.away) > max(DOUBTED * self.rough, MATTERS * usual)
        # beside it, too: in the very row of a leap, filter and differences both have the mean of both sides
        far = far | np.append(far[1:], False) | np.append(False, far[:-1])
        return far & (np.mean(far) < MOST) if len(far) else far

    @property
    def trusted(self) -> np.ndarray:
        """(T,) the rate, NaN where it is doubted."""
        return np.where(self.doubted, np.nan, self.rate)

    @property
    def error(self) -> float:
        """1 sigma of the error of the rates that are not doubted; NaN where there are none."""
        away = self.away[~self.doubted]
        if not len(away):
            return np.nan
        left = self.rough if self.gain is None else self.noise * self.gain
        taken = max(float(np.mean(away**2)) - SURE * max(self.rough**2 - left**2, 0.0), 0.0)
        return float(np.sqrt(left**2 + taken))


def _noise_gain(filter_hz: float, period: float) -> float:
    """Noise of a filtered rate for each unit of noise of its signal [1/s]: the norm of its response to an impulse."""
    impulse = np.zeros(2 * round(2.0 / (filter_hz * period)) + 101)
    impulse[len(impulse) // 2] = 1.0
    return float(np.linalg.norm(np.gradient(_smooth(impulse, filter_hz, period), period)))


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

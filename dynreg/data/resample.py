"""Resampling from the log's own stamps to the robot's control rate; every change is reported."""

import numpy as np

from dynreg.data.derivative import GRID_LIMIT
from dynreg.data.episodes import RawEpisode
from dynreg.data.gaps import silent
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import Series
from dynreg.errors import LogError
from dynreg.limits import limits, refuse

STAMP_TOLERANCE = 1e-6  # [s] a command stamped this much after a grid point still counts for it


def clean(series: Series) -> Series:
    """Rows with a finite value on strictly increasing stamps; the last row of equal stamps is kept."""
    series = series.rows(np.isfinite(series.values) & np.isfinite(series.time))
    if len(series) < 2:
        return series
    return series.rows(np.append(np.diff(series.time) > 0, True))


def resample(episode: RawEpisode, spec: RecordingSpec) -> tuple[float, np.ndarray, np.ndarray]:
    """Bring an episode's channels to one time base.

    States and inputs are interpolated linearly; actions and flags hold their last value. Where a signal has NaN for
    longer than can be filled in (`gaps.silences`) it stays NaN. The grid runs from
    the first stamp that all channels have reached to the last that none has left (a held flag need not be
    repeated to stand), at `spec.rate`; without a rate it has the stamps of the first action.

    Returns
    -------
    start : [s] the first common stamp on the log's clock; it becomes time 0.
    time : (T,) [s] from 0.
    values : (T, C) in the order of `spec.channels`, NaN for channels that the episode does not have.

    Raises LogError where the channels have fewer than two samples in common.
    """
    series = {name: clean(s) for name, s in episode.channels.items()}
    series = {name: s for name, s in series.items() if len(s)}
    start, end = common_span(episode, series, spec)
    grid = _grid(episode, series, spec, start, end)
    values = np.full((len(grid), len(spec.channels)), np.nan)
    for column, channel in enumerate(spec.channels):
        if channel.name in series:
            kept = series[channel.name]
            values[:, column] = at(kept, start + grid, channel.hold)
            raw = episode.channels[channel.name]
            nothing = raw.time[~np.isfinite(raw.values)]
            # a command or a flag that mostly has no number is one that is logged when it changes, and holds
            if not channel.hold or 2 * len(nothing) <= len(raw):
                values[silent(kept.time, nothing, start + grid), column] = np.nan
    return start, grid, values


def at(series: Series, time: np.ndarray, hold: bool) -> np.ndarray:
    """(T,) values of a signal at `time`, held or interpolated."""
    if not hold:
        return np.interp(time, series.time, series.values)
    last = np.searchsorted(series.time, time + STAMP_TOLERANCE, side="right") - 1
    return series.values[np.maximum(last, 0)]


def common_span(episode: RawEpisode, series: dict[str, Series], spec: RecordingSpec) -> tuple[float, float]:
    """First and last stamp [s] between which every channel is known."""
    kinds = {c.name: c.kind for c in spec.channels}
    start = max((s.time[0] for s in series.values()), default=0.0)
    ends = {name: s.time[-1] for name, s in series.items() if kinds[name] != "enable"}
    end = min(ends.values(), default=0.0)
    if not end > start:
        late = max(series, key=lambda n: series[n].time[0], default="?")
        early = min(ends, key=lambda n: ends[n], default="?")
        raise LogError(
            f"{episode.file}, episode {episode.name!r}: {early!r} ends at {end:.3f} s, "
            f"before {late!r} begins at {start:.3f} s",
            expected="channels that overlap in time",
            do="check their clocks, or set `delay` in the map",
        )
    return float(start), float(end)


def _grid(
    episode: RawEpisode, series: dict[str, Series], spec: RecordingSpec, start: float, end: float
) -> np.ndarray:
    if spec.rate is None:
        names = [c.name for c in spec.channels if c.kind == "action"] + [c.name for c in spec.channels]
        base = series[next(name for name in names if name in series)].time
        grid = base[(base >= start) & (base <= end)] - start
    else:
        most = (
            np.floor((end - start) * spec.rate + STAMP_TOLERANCE * spec.rate) + 1
        )  # of far stamps, infinite
        logged = max(len(s) for s in series.values())
        if most > max(GRID_LIMIT, 200 * logged):
            raise LogError(
                f"{episode.file}, episode {episode.name!r}: {logged} samples over {end - start:.4g} s "
                f"would become {most:.0f} rows at {spec.rate:g} Hz",
                expected="a clock in seconds",
                do='set time_unit = "ms", "us" or "ns" under [map]',
            )
        rows = int(most)
        if rows * len(spec.channels) > limits().numbers:
            asked = f"{episode.file}, episode {episode.name!r}, becomes more numbers than are kept"
            refuse(LogError, asked, rows * len(spec.channels), "numbers")
        grid = np.arange(rows) / spec.rate
    if len(grid) < 2:
        raise LogError(
            f"{episode.file}, episode {episode.name!r} has {len(grid)} samples in common to all channels",
            expected="at least 2",
            do="record a longer run, or leave this file out",
        )
    return grid

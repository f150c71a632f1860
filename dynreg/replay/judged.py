"""What replays of a held-out part say: the gain of a simulator over another, its errors, the traces that are drawn."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.robot import Robot

WINDOWS = 3  # that are drawn,
POINTS = 300  # of each trace


@dataclass(frozen=True)
class Traced:
    """One channel in one window, thinned and rounded: time [s], measured and simulated values, None where unknown."""

    episode: str
    channel: str
    unit: str
    time: list[float]
    measured: list[float | None]
    simulated: tuple[list[float | None], ...]


@dataclass(frozen=True)
class Gain:
    """A relative gain with its 90 % interval; None where there are too few windows for one."""

    value: float
    low: float | None
    high: float | None


def gain(before: np.ndarray, after: np.ndarray) -> Gain | None:
    """1 - after / before of errors (W,) by window, with a 90 % bootstrap interval over windows.

    None where there was no error that could be reduced.
    """
    if not before.mean() > 0:
        return None
    value = 1.0 - after.mean() / before.mean()
    if len(before) < 3:
        return Gain(value=float(value), low=None, high=None)
    draws = stream(0, "bootstrap").integers(0, len(before), (2000, len(before)))
    gains = 1.0 - after[draws].mean(axis=1) / before[draws].mean(axis=1)
    low, high = np.quantile(gains, [0.05, 0.95])
    return Gain(value=float(value), low=float(low), high=float(high))


def channel_errors(windows: Windows, states: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(n, S) mean absolute error of simulators' states (n, W, T+1, S) in each channel, in its unit.

    Of what was measured in the windows `chosen`; NaN for channels that were not.
    """
    miss = np.abs(states[..., 1:, :] - windows.measured[chosen][:, 1:])
    known = np.isfinite(miss)
    count = known.sum(axis=(1, 2))
    return np.where(count > 0, np.where(known, miss, 0.0).sum(axis=(1, 2)) / np.maximum(count, 1), np.nan)


def traced(
    robot: Robot,
    recording: Recording,
    windows: Windows,
    states: np.ndarray,
    chosen: np.ndarray,
    *,
    worst: int,
    channels: int,
) -> Iterator[Traced]:
    """Simulators' states (n, W, T+1, S) beside what was measured in the windows `chosen`: some windows, evenly.

    Of `channels` channels, those in which simulator number `worst` errs most.
    """
    measured = windows.measured[chosen]
    weighted = np.flatnonzero(windows.weight > 0)
    miss = np.abs(states[worst] - measured)
    size = [np.nanmean(miss[:, 1:, c]) / windows.spread[c] for c in weighted]
    for w in _thinned(np.arange(len(chosen)), WINDOWS):
        rows = _thinned(np.flatnonzero(np.isfinite(measured[w]).any(axis=1)), POINTS)
        for c in weighted[np.argsort(size)[::-1][:channels]]:
            yield Traced(
                recording.episodes[windows.episode[chosen[w]]].name,
                robot.channels[c],
                robot.file.channels[c].unit,
                [round(float(t * windows.period), 6) for t in rows],
                _rounded(measured[w, rows, c]),
                tuple(_rounded(s[w, rows, c]) for s in states),
            )


def _thinned(items: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the items (N,), evenly, the first and the last among them."""
    return items[np.unique(np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int))]


def _rounded(values: np.ndarray) -> list[float | None]:
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values]

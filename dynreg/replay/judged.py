"""What replays of a held-out part say: the gain of a simulator over another, its errors, the traces that are drawn."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.residual import missed
from dynreg.replay.windows import Windows
from dynreg.rng import stream
from dynreg.sim.robot import Robot

WINDOWS = 3  # that are drawn,
POINTS = 300  # of each trace
LEAST = 3  # episodes (or windows) from which an interval is told
# Of fewer, the quantiles of a bootstrap are too narrow. With log-normal errors of windows (0.5) and of what a simulator
# does to them (0.3) its 90 % come true in 60, 77, 82 and 84 % of draws of 3, 5, 8 and 12; by Student's they
# do in 90, 88, 87 and 86 %.
MANY = 12
DRAWS = 2000  # of the bootstrap


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
    """A relative gain with its 90 % interval over episodes or windows; None where these are too few for one."""

    value: float
    low: float | None
    high: float | None
    over: Literal["episodes", "windows"] | None = None


def gain(before: np.ndarray, after: np.ndarray, episode: np.ndarray) -> Gain | None:
    """1 - after / before of errors (W,) by window, with a 90 % interval over episodes (W,), numbers of the windows'.

    Windows of an episode err alike, so they are counted together; where they are of fewer than `LEAST` episodes, each
    counts by itself. None where there was no error that could be reduced.
    """
    if not before.mean() > 0:
        return None
    value = float(1.0 - after.mean() / before.mean())
    names, groups = np.unique(episode, return_inverse=True)
    over: Literal["episodes", "windows"] = "episodes" if len(names) >= LEAST else "windows"
    if over == "episodes":
        before, after = np.bincount(groups, before), np.bincount(groups, after)
    bounds = ratio(before, after)
    if bounds is None:
        return Gain(value, None, None)
    low, high = bounds
    return Gain(value, float(1.0 - high), float(1.0 - low), over)


def ratio(before: np.ndarray, after: np.ndarray) -> np.ndarray | None:
    """(2, ...) the 90 % interval of sum(after) / sum(before) over blocks (B, ...); None for fewer than `LEAST` of them.

    NaN where `before` is nothing in all blocks; draws of which nothing is known do not count.
    """
    if len(before) < LEAST:
        return None
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice")
        return _student(before, after) if len(before) < MANY else _bootstrap(before, after)


def _student(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The interval from few blocks: Student's, of the logarithm of the ratio of means.

    By the delta method: what a block before does not explain of that after counts by its size, so that one in which
    hardly anything moves says little.
    """
    from scipy.stats import t

    left = after.mean(axis=0) / before.mean(axis=0)
    scatter = (after - left * before).std(axis=0, ddof=1) / after.mean(axis=0)
    half = t.ppf(0.95, len(before) - 1) * scatter / np.sqrt(len(before))
    return np.where(left == 0, 0.0, left * np.exp(np.stack([-half, half])))


def _bootstrap(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The interval from many blocks, drawn anew."""
    blocks = len(before)
    chosen = stream(0, "bootstrap").integers(0, blocks, (DRAWS, blocks))
    weight = np.stack([np.bincount(row, minlength=blocks) for row in chosen]).astype(float)
    drawn = np.tensordot(weight, after, axes=1) / np.tensordot(weight, before, axes=1)
    return np.nanquantile(drawn, [0.05, 0.95], axis=0)


def channel_errors(windows: Windows, states: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(n, S) mean absolute error of simulators' states (n, W, T+1, S) in each channel, in its unit.

    Of what was measured in the windows `chosen`; NaN for channels that were not. See `residual.missed`.
    """
    miss = missed(states[..., 1:, :], windows.measured[chosen][:, 1:], windows.spread)
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
    weighted = np.flatnonzero((windows.weight > 0) & np.isfinite(measured[:, 1:]).any(axis=(0, 1)))
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

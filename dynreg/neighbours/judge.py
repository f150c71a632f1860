"""Judge the answer of a query: gain, channels, traces, and whether anything in the family fits."""

from typing import TYPE_CHECKING

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.windows import Windows
from dynreg.results import ChannelError, Gain, Trace
from dynreg.rng import stream
from dynreg.sim.robot import Robot

if TYPE_CHECKING:
    from dynreg.neighbours.query import _Search

TRACES = 6  # channels and
EPISODES = 3  # windows shown in a report
POINTS = 300  # of each trace
TOO_FAR = 3.0  # times the error that the neighbours' own simulators leave


def gain(test: dict[int, np.ndarray], nominal: int, answer: int) -> Gain | None:
    """1 - error(answer) / error(nominal) on the test windows, with a 90 % bootstrap interval over windows.

    None where the nominal simulator makes no error that could be reduced.
    """
    before, after = test[nominal], test[answer]
    if not before.mean() > 0:
        return None
    value = 1.0 - after.mean() / before.mean()
    if len(before) < 3:
        return Gain(value=float(value), low=None, high=None)
    draws = stream(0, "bootstrap").integers(0, len(before), (2000, len(before)))
    gains = 1.0 - after[draws].mean(axis=1) / before[draws].mean(axis=1)
    low, high = np.quantile(gains, [0.05, 0.95])
    return Gain(value=float(value), low=float(low), high=float(high))


def channel_errors(
    robot: Robot, windows: Windows, pair: np.ndarray, chosen: np.ndarray, spread: np.ndarray
) -> tuple[ChannelError, ...]:
    """Mean absolute error of every measured channel, nominal and answer (2, W, T+1, S), worst share first."""
    measured = windows.measured[chosen]
    out = []
    for s, table in enumerate(robot.file.channels):
        difference = np.abs(pair[..., 1:, s] - measured[:, 1:, s])
        if not np.isfinite(difference).any():
            continue
        before, after = np.nanmean(difference, axis=(1, 2))
        out.append(
            ChannelError(
                channel=table.name, unit=table.unit, nominal=before, answer=after, spread=float(spread[s])
            )
        )
    return tuple(sorted(out, key=lambda c: -c.answer / c.spread))


def traces(
    robot: Robot,
    recording: Recording,
    windows: Windows,
    pair: np.ndarray,
    chosen: np.ndarray,
    spread: np.ndarray,
) -> tuple[Trace, ...]:
    """What a report draws: the channels with the largest nominal error, in the first windows."""
    measured = windows.measured[chosen]
    weighted = np.flatnonzero(windows.weight > 0)
    size = [np.nanmean(np.abs(pair[0][:, 1:, s] - measured[:, 1:, s])) / spread[s] for s in weighted]
    shown = weighted[np.argsort(size)[::-1][:TRACES]]
    per = max(1, min(EPISODES, len(chosen)))
    out = []
    for w in np.unique(np.linspace(0, len(chosen) - 1, per).round().astype(int)):
        rows = np.flatnonzero(np.isfinite(measured[w]).any(axis=1))
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(POINTS, len(rows))).round().astype(int))]
        for s in shown:
            series = (measured[w, rows, s], pair[0, w, rows, s], pair[1, w, rows, s])
            numbers = [[_number(v) for v in x] for x in series]
            out.append(
                Trace(
                    episode=recording.episodes[windows.episode[chosen[w]]].name,
                    channel=robot.channels[s],
                    unit=robot.file.channels[s].unit,
                    time=[round(float(t * windows.period), 6) for t in rows],
                    measured=numbers[0],
                    nominal=numbers[1],
                    answer=numbers[2],
                )
            )
    return tuple(out)


def alarm(search: "_Search", answer: int) -> tuple[float, str | None, tuple[str, ...]]:
    """Whether the family holds nothing close: the misfit, the alarm's sentence or None, and notes.

    Each neighbour is taken for the robot in turn: how far is its nearest fellow, under these very commands?
    A robot of the family is about as far from its nearest neighbour as they are from theirs.
    """
    residuals = search.evidence.residuals[: search.first].reshape(search.first, -1).astype(float)
    apart = np.array([np.nanmean(np.abs(residuals - r), axis=1) for r in residuals])
    np.fill_diagonal(apart, np.inf)
    usual = float(np.median(apart.min(axis=1)))
    mine = float(search.evidence.fit[answer])
    ratio = mine / max(usual, 1e-12)
    note = (
        f"the answer's error is {ratio:.2g} times what separates neighbouring simulators under these commands"
    )
    if ratio <= TOO_FAR:
        return ratio, None, (note,)
    sentence = (
        f"no simulator in this family is close to the robot: the best one's error is {ratio:.2g} times what "
        f"separates neighbours (alarm above {TOO_FAR:g}); something is missing from the model, or its "
        f"ranges are too narrow: widen them, or extend the model where the listed channels err most"
    )
    return ratio, sentence, (note,)


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None

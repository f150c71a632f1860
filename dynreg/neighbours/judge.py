"""Judge the answer of a query: channels, traces, and whether anything in the family fits."""

from typing import TYPE_CHECKING

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.judged import traced
from dynreg.replay.windows import Windows
from dynreg.results import ChannelError, Trace
from dynreg.sim.robot import Robot

if TYPE_CHECKING:
    from dynreg.neighbours.query import _Search

TRACES = 6  # channels shown in a report
TOO_FAR = 3.0  # times the error that the neighbours' own simulators leave


def channel_errors(
    robot: Robot, windows: Windows, pair: np.ndarray, chosen: np.ndarray
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
                channel=table.name,
                unit=table.unit,
                nominal=before,
                answer=after,
                spread=float(windows.spread[s]),
            )
        )
    return tuple(sorted(out, key=lambda c: -c.answer / c.spread))


def traces(
    robot: Robot, recording: Recording, windows: Windows, pair: np.ndarray, chosen: np.ndarray
) -> tuple[Trace, ...]:
    """What a report draws of nominal and answer (2, W, T+1, S): the channels with the largest nominal error."""
    return tuple(
        Trace(
            episode=one.episode,
            channel=one.channel,
            unit=one.unit,
            time=one.time,
            measured=one.measured,
            nominal=one.simulated[0],
            answer=one.simulated[1],
        )
        for one in traced(robot, recording, windows, pair, chosen, worst=0, channels=TRACES)
    )


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

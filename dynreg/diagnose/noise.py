"""The sensor noise of a log, estimated from row to row, and compared with robot.toml."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.jitter import NORMAL
from dynreg.sim.robot import Robot

TWICE = 2.0  # the estimate replaces the stated noise from this ratio on: by contract
ORDERS = range(
    3, 9
)  # of the differences from row to row: the higher the order, the less motion remains in them


def own_noise(robot: Robot, recording: Recording) -> dict[str, float]:
    """{channel: 1 sigma} of the weighted channels that are more than twice as noisy as stated.

    Rounded to powers of two times the stated noise, so that logs of one sensor get the same value.
    """
    out = {}
    for channel, stated in zip(robot.file.channels, robot.sensor_noise, strict=True):
        if not (channel.weight > 0 and stated > 0 and channel.name in recording.names):
            continue
        column = recording.names.index(channel.name)
        ratio = scatter([e.values[:, column] for e in recording.episodes]) / stated
        if ratio > TWICE:
            out[channel.name] = float(stated * 2.0 ** np.round(np.log2(ratio)))
    return out


def scatter(episodes: Sequence[np.ndarray]) -> float:
    """1 sigma of the white noise in a channel's episodes, each (T,); 0 if there are too few rows.

    From the median absolute difference from row to row, the least over several orders: white noise gives the same
    estimate in all of them, and motion adds less in the higher ones.
    """
    found = []
    for order in ORDERS:
        sizes = np.concatenate([np.abs(np.diff(e, n=order)) for e in episodes])
        sizes = sizes[np.isfinite(sizes)]
        if not len(sizes):
            return 0.0
        # the variance of these differences is comb(2 order, order) times that of the white noise
        found.append(float(np.median(sizes)) / NORMAL / math.sqrt(math.comb(2 * order, order)))
    return min(found)


def noisier(robot: Robot, noise: Mapping[str, float]) -> Robot:
    """The robot with this sensor noise {channel: 1 sigma}."""
    if not noise:
        return robot
    channels = [
        c.model_copy(update={"noise": noise[c.name]}) if c.name in noise else c for c in robot.file.channels
    ]
    return replace(robot, file=robot.file.model_copy(update={"channels": channels}))

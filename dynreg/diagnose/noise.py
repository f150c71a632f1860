"""The noise of a log, told from row to row, held against what robot.toml states."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.sim.robot import Robot

TWICE = 2.0  # times the stated noise, from which a log's own counts: by contract
ORDER = 3  # of the differences from row to row: what a motion changes in them is small beside the noise
NORMAL = 0.6745  # median of the absolute value of a standard normal variable
GROWS = math.comb(2 * ORDER, ORDER)  # times that of white noise is the variance of such differences


def own_noise(robot: Robot, recording: Recording) -> dict[str, float]:
    """{channel: 1 sigma} of the channels with a weight that are more than twice as noisy as stated.

    By the median size of third differences. In powers of two times the stated one, so that logs of one sensor are told
    the same.
    """
    out = {}
    for channel, stated in zip(robot.file.channels, robot.sensor_noise, strict=True):
        if not (channel.weight > 0 and stated > 0 and channel.name in recording.names):
            continue
        column = recording.names.index(channel.name)
        rows = [np.abs(np.diff(e.values[:, column], n=ORDER)) for e in recording.episodes]
        sizes = np.concatenate([r[np.isfinite(r)] for r in rows])
        if len(sizes) and (ratio := np.median(sizes) / NORMAL / np.sqrt(GROWS) / stated) > TWICE:
            out[channel.name] = float(stated * 2.0 ** np.round(np.log2(ratio)))
    return out


def noisier(robot: Robot, noise: Mapping[str, float]) -> Robot:
    """The robot with sensors of this noise {channel: 1 sigma}."""
    if not noise:
        return robot
    channels = [
        c.model_copy(update={"noise": noise[c.name]}) if c.name in noise else c for c in robot.file.channels
    ]
    return replace(robot, file=robot.file.model_copy(update={"channels": channels}))

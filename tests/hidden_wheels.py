"""Hidden robots on two wheels, logged 20 times a second by a tracker above them."""

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.timed.commands import Commands, chained
from dynreg.timed.reference import Reference, on_the_way
from dynreg.timed.unicycle import KHEPERA

PERIOD = 0.05  # s
RADIUS, TRACK = 0.021, 0.0884  # m, of robots/diffdrive
NOISE = np.array([0.001, 0.001, np.radians(0.5)])  # of the tracker [m, m, rad]
SPEED = 0.22  # m/s, of the fastest wheel
CHANNELS = (
    ("base/x", "m"),
    ("base/y", "m"),
    ("base/yaw", "rad"),
    ("left_wheel/velocity_command", "rad/s"),
    ("right_wheel/velocity_command", "rad/s"),
)


def robot(pattern: str = "", factor: float = 1.0) -> Reference:
    """A Khepera whose wheels are not quite alike, with what changed."""
    plain = Reference(KHEPERA, TRACK, left=0.98, right=1.01)
    return plain.changed(pattern, factor) if pattern else plain


def logged(
    hidden: Reference,
    seed: int,
    *,
    episodes: int = 12,
    each: int = 50,
    like: str = "",
    ticks: tuple[int, int] = (2, 40),
    noise: float = 1.0,
) -> Recording:
    """Random wheel speeds held for `ticks` periods (from, to), `each` of them in an episode.

    like : "straight", both wheels are told the same; "left alone", the right one to stand still; else anything.
    noise : factor on the tracker's.
    """
    rng = stream(seed, "hidden wheels")
    return Recording(
        tuple(Channel(name, unit) for name, unit in CHANNELS),
        tuple(_episode(hidden, f"e{i}", each, like, ticks, noise * NOISE, rng) for i in range(episodes)),
    )


def _episode(
    hidden: Reference,
    name: str,
    each: int,
    like: str,
    ticks: tuple[int, int],
    noise: np.ndarray,
    rng: np.random.Generator,
) -> Episode:
    told = rng.uniform(-SPEED, SPEED, (each, 2))
    if like == "straight":
        told[:, 1] = told[:, 0]
    if like == "left alone":
        told[:, 1] = 0.0
    rows = told.repeat(rng.integers(ticks[0], ticks[1] + 1, each), axis=0)
    # the wheels do what they are told times their gains, and the lags go on from row to row
    driven = rows * [hidden.left, hidden.right]
    before = np.concatenate([np.zeros((1, 2)), driven[:-1]])
    commands = Commands(*driven.T, np.full(len(rows), PERIOD), *before.T)
    plain = Reference(hidden.parameters, hidden.track / hidden.turns)
    begun = on_the_way(commands, np.zeros(len(rows), dtype=int), plain)
    pose = chained(plain.predict(begun), np.array([0.1, -0.2, 2.0 * np.pi * rng.uniform()]))
    pose = pose + noise * rng.standard_normal(pose.shape)
    values = np.concatenate([pose, np.concatenate([rows, rows[-1:]]) / RADIUS], axis=1)
    return Episode(name, PERIOD * np.arange(len(pose)), values)

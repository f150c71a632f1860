"""Hidden robots on two wheels, moved by the unicycle engine and logged 20 times a second by a tracker above them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

PERIOD = 0.05  # s
RADIUS = 0.021  # m, of robots/diffdrive
NOISE = np.array([0.001, 0.001, np.radians(0.5)])  # of the tracker [m, m, rad]
SPEED = 0.22  # m/s, of the fastest wheel
POSE = ("base/x", "base/y", "base/yaw")
CHANNELS = (
    *zip(POSE, ("m", "m", "rad"), strict=True),
    ("left_wheel/velocity_command", "rad/s"),
    ("right_wheel/velocity_command", "rad/s"),
)


@dataclass(frozen=True)
class Hidden:
    """What is not as diffdrive's robot.toml says: factors on both wheels and on turns, the floor's grip [m/s^2]."""

    left: float = 0.98
    right: float = 1.01
    turns: float = 1.0
    grip: float = np.nan


@dataclass(frozen=True)
class Told:
    """Random wheel speeds held for `ticks` periods (from, to), `each` of them in an episode.

    like : "straight", both wheels are told the same; "left alone", the right one to stand still; else anything.
    noise : factor on the tracker's.
    """

    episodes: int = 12
    each: int = 50
    like: str = ""
    ticks: tuple[int, int] = (2, 40)
    noise: float = 1.0

    def wheels(self, rng: np.random.Generator) -> np.ndarray:
        """(T, 2) speeds [rad/s] of an episode, a row a period."""
        told = rng.uniform(-SPEED, SPEED, (self.each, 2)) / RADIUS
        if self.like == "straight":
            told[:, 1] = told[:, 0]
        if self.like == "left alone":
            told[:, 1] = 0.0
        return told.repeat(rng.integers(self.ticks[0], self.ticks[1] + 1, self.each), axis=0)


def robot(pattern: str = "", factor: float = 1.0, **more: float) -> Hidden:
    """A Khepera whose wheels are not quite alike, with what changed."""
    plain = Hidden(**more)
    sides = {"left wheel": ("left",), "right wheel": ("right",), "all speeds": ("left", "right")}
    changed = sides.get(pattern, ("turns",))
    return replace(plain, **{side: factor * getattr(plain, side) for side in changed})


def logged(hidden: Hidden, seed: int, **how: object) -> Recording:
    """What the logger of a hidden robot writes; `how` is that of `Told`."""
    return logs([(hidden, seed)], **how)[0]


def logs(hidden: Sequence[tuple[Hidden, int]], **how: object) -> list[Recording]:
    """What the loggers of hidden robots write, each with its own seed, simulated all at once."""
    plan = Told(**how)
    draws = [stream(seed, "hidden wheels") for _, seed in hidden]
    told = [[plan.wheels(rng) for _ in range(plan.episodes)] for rng in draws]
    longest = max(len(rows) for own in told for rows in own)
    actions = np.array(
        [[np.pad(rows, ((0, longest - len(rows)), (0, 0)), mode="edge") for rows in own] for own in told]
    )
    states = _driven([one for one, _ in hidden], actions)
    out = []
    for rng, own, moved in zip(draws, told, states, strict=True):
        episodes = []
        for i, (rows, poses) in enumerate(zip(own, moved, strict=True)):
            poses = poses[: len(rows) + 1] + plan.noise * NOISE * rng.standard_normal((len(rows) + 1, 3))
            values = np.concatenate([poses, np.concatenate([rows, rows[-1:]])], axis=1)
            episodes.append(Episode(f"e{i}", PERIOD * np.arange(len(values)), values))
        out.append(Recording(tuple(Channel(name, unit) for name, unit in CHANNELS), tuple(episodes)))
    return out


def _driven(hidden: Sequence[Hidden], actions: np.ndarray) -> np.ndarray:
    """(B, E, T+1, 3) poses of hidden robots that are told actions (B, E, T, 2).

    The engine has one radius for both wheels and a relative difference between them; a smaller track turns more.
    """
    diffdrive = load_robot("diffdrive")
    names = list(diffdrive.space.names)
    values = np.tile([p.nominal for p in diffdrive.space.parameters], (len(hidden), 1))
    left, right, turns, grip = np.array([(h.left, h.right, h.turns, h.grip) for h in hidden]).T
    values[:, names.index("wheel_radius")] *= 0.5 * (left + right)
    values[:, names.index("track")] /= turns
    terms = Terms(
        (term("wheel_gain"), term("wheel_slip")),
        ((2.0 * (right - left) / (left + right))[:, None], grip[:, None]),
    )
    start = np.zeros((actions.shape[1], len(diffdrive.channels)))
    pose = [diffdrive.channels.index(name) for name in POSE]
    start[:, pose] = [0.1, -0.2, 2.0]
    run = Run(actions, period=PERIOD, initial=start)
    return rollout(diffdrive, values, run, engine="unicycle", terms=terms).states[..., pose]

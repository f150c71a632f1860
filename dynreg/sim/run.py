"""What is asked of an engine, and what it gives back."""

from dataclasses import dataclass, field, replace

import numpy as np

from dynreg.errors import UsageError
from dynreg.rng import stream


@dataclass(frozen=True)
class Run:
    """Episodes of commands that each of B simulators executes; an engine has one simulator for each episode.

    Attributes
    ----------
    actions : (E, T, A), or (B, E, T, A) where simulators get commands of their own; in the actions' units.
    inputs : (E, T, I) measured exogenous signals, enable channels included; None takes the robot's defaults.
    settings : (E, K) known constants of each episode; None takes the nominal ones.
    initial : (E, S) state to start from, NaN where it is not known; None starts from the robot's reset pose.
    velocity : (E, 2) speed [m/s] and yaw rate [rad/s] that planar bases start with where no channel of `initial` tells
        them; NaN or None for a start at rest, or from what was told `before`.
    before : (E, L, A) commands of the rows before the first, NaN where they are not known; None for none. Delays, lags
        and profiles look back at them, and planar bases start with the velocity that their own lags make of them, from
        standstill.
    period : seconds between commands; None takes each simulator's own command rate.
    noise : (E, T, A), or (B, E, T, A) as the actions: standard normal draws for the motor noise; None runs without it.
    draws : in the same shapes, what effects read as `Moment.draw`: what disturbs hidden robots; None for 0.
    begin : (E,) seconds from the start of the log to that of each episode; None starts them all at once. What reads
        `Moment.time`, such as `friction_drift`, goes on from there; what is in `Moment.memory` (heat, the place in a
        play) begins anew, but for what follows from `before` alone.
    joints : the driven joints that are looked at; None for all. An engine in which joints move alone leaves the
        others out, and their channels are NaN.
    """

    actions: np.ndarray
    inputs: np.ndarray | None = None
    settings: np.ndarray | None = None
    initial: np.ndarray | None = None
    period: float | None = None
    noise: np.ndarray | None = None
    begin: np.ndarray | None = None
    joints: tuple[str, ...] | None = None
    velocity: np.ndarray | None = None
    before: np.ndarray | None = None
    draws: np.ndarray | None = None

    def __post_init__(self):
        if self.actions.ndim not in (3, 4):
            raise UsageError(
                f"actions of shape {self.actions.shape}",
                expected="(episodes, steps, actions) or (simulators, episodes, steps, actions)",
                do="reshape them",
            )

    @property
    def episodes(self) -> int:
        """E, how many."""
        return self.actions.shape[-3]

    @property
    def steps(self) -> int:
        """T, commands in an episode."""
        return self.actions.shape[-2]

    @property
    def rolling(self) -> np.ndarray | None:
        """(E, L, A) what planar bases were told `before` of whose velocity at the start nothing else tells; else 0."""
        if self.before is None or self.velocity is None:
            return None
        return np.where(np.isnan(self.velocity).any(axis=1)[:, None, None], np.nan_to_num(self.before), 0.0)

    def take(self, episodes: np.ndarray) -> "Run":
        """Only these episodes (indexes)."""
        given = {name: getattr(self, name) for name in (*OF_EPISODES, *OF_STEPS)}
        own = {
            name: a[episodes] if name in OF_EPISODES else a[..., episodes, :, :]
            for name, a in given.items()
            if a is not None
        }
        return replace(self, **own)

    def until(self, steps: int) -> "Run":
        """Only the first commands of each episode."""
        own = {name: a[..., :steps, :] for name in OF_STEPS if (a := getattr(self, name)) is not None}
        inputs = None if self.inputs is None else self.inputs[:, :steps]
        return replace(self, **own, inputs=inputs)


OF_EPISODES = ("inputs", "settings", "initial", "begin", "velocity", "before")  # fields of Run, each (E, ...)
OF_STEPS = ("actions", "noise", "draws")  # each (E, T, A), or (B, E, T, A)


@dataclass(frozen=True)
class Simulated:
    """What an engine gives back of N independent simulations: states (N, T+1, S) at the command times.

    fell : (N,) the first step at which the robot had fallen, T+1 where it had not. taken : (N,) time steps.
    """

    states: np.ndarray
    fell: np.ndarray
    taken: np.ndarray


@dataclass(frozen=True)
class Rollout:
    """What B simulators did: states (B, E, T+1, S) at the command times, the start included.

    fell : (B, E) the first step at which the robot had fallen, T+1 where it had not.
    physics_steps : time steps taken, over all simulators.
    """

    states: np.ndarray
    fell: np.ndarray
    physics_steps: int


@dataclass(frozen=True)
class Walk:
    """How the floating base of B simulators moved in E episodes, at the command times, the start included.

    base : (B, E, T+1, 12) position [m] and Euler angles [rad] in the world, velocity [m/s, rad/s] in the body's
        frame, in the order of `layout.BASE`; it stays where it was before a fall.
    fell : (B, E) the first step at which the robot had fallen or diverged, T+1 where it had not.
    physics_steps : time steps taken, over all simulators.
    contact : {foot: (B, E, T+1)} whether it touches the ground, where that was asked for.
    bodies : (B, E, T+1, n, 3) where the bodies are that the robot's folder tracks [m], in its order; they stay where
        they were before a fall. None where it tracks none, or nobody saw them.
    """

    base: np.ndarray
    fell: np.ndarray
    physics_steps: int
    contact: dict[str, np.ndarray] = field(default_factory=dict)
    bodies: np.ndarray | None = None


def motor_noise(seeds: np.ndarray, episodes: int, steps: int, actions: int) -> np.ndarray:
    """(B, E, T, A) standard normal draws; those of a simulator depend on its seed alone."""
    return np.stack(
        [stream(int(s), "motor noise").standard_normal((episodes, steps, actions)) for s in seeds]
    )

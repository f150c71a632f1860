"""Open-loop rollouts of a recording from its measured states, and their errors, for any simulator."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.replay.velocity import base_velocities
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run


@dataclass(frozen=True)
class Segments:
    """Pieces of a recording. measured : (W, T+1, S) states. commands : (W, T, A). period : s between them.

    velocity : (W, 2) that a planar base has at the first row (`base_velocities`), None for other robots.
    """

    measured: np.ndarray
    commands: np.ndarray
    period: float
    velocity: np.ndarray | None = None

    @classmethod
    def cut(
        cls, robot: Robot, recording: Recording, names: list[str], seconds: float, every: float
    ) -> "Segments":
        """Pieces of `seconds` that begin every `every` seconds of the episodes `names`."""
        states, actions = recording.columns(robot.channels), recording.columns(robot.actions)
        steps, stride = round(seconds * robot.rate), round(every * robot.rate)
        chosen = [e for e in recording.episodes if e.name in names]
        begins = [np.arange(0, len(e.time) - steps, stride) for e in chosen]
        values = np.stack(
            [e.values[at : at + steps + 1] for e, rows in zip(chosen, begins, strict=True) for at in rows]
        )
        fast = [
            base_velocities(robot, e.values[:, states], rows, 1.0 / robot.rate)
            for e, rows in zip(chosen, begins, strict=True)
        ]
        velocity = None if fast[0] is None else np.concatenate(fast)
        return cls(values[:, :, states], values[:, :-1, actions], 1.0 / robot.rate, velocity)

    def take(self, which: np.ndarray) -> "Segments":
        """Some of them."""
        velocity = None if self.velocity is None else self.velocity[which]
        return Segments(self.measured[which], self.commands[which], self.period, velocity)

    def positions(self, count: int) -> np.ndarray:
        """(W, T+1, count): the first channels, which are the joints' positions."""
        return self.measured[..., :count]


def simulated(robot: Robot, config: SimConfig, segments: Segments) -> np.ndarray:
    """(W, T+1, S) what a registered simulator does from the measured states under the measured commands."""
    run = Run(
        segments.commands,
        initial=segments.measured[:, 0],
        period=segments.period,
        velocity=segments.velocity,
    )
    values = robot.space.from_dict(dict(config.values))[None]
    return rollout(robot, values, run, threads=1, terms=terms_of(config, robot)).states[0]


def window_errors(states: np.ndarray, segments: Segments, joints: int) -> np.ndarray:
    """(W,) root mean square over a window and its `joints` positions."""
    apart = states[..., :joints] - segments.positions(joints)
    return np.sqrt(np.mean(apart[:, 1:] ** 2, axis=(1, 2)))


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))

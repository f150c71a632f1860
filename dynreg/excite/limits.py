"""What commands of an experiment keep to: limits, the rates of drives, the stops of joints; and where patterns go."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.names import parts_of, quantity_of
from dynreg.errors import RobotError
from dynreg.sim.excitation import command_limits, command_range, outside_limits, reset_pose, targets
from dynreg.sim.ports import Ports, nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.sets import is_limit

INSIDE = 0.95  # of the room around their centre that patterns use at most
CROWDED = 0.05  # of a range: less room on one side of the reset pose holds no half of a pattern
BACK = 5  # in the last part of so many of an episode targets go back to the reset pose
BEYOND = 0.02  # of its range that a joint may be expected to press itself past its stops
# Of its range a second: a joint that reaches a stop faster hits it. At this speed its whole range takes 10 s, as when a
# hand leads it there. In none of 376 candidates for five packaged robots a joint reaches a stop at any speed.
SLOW = 0.1


@dataclass(frozen=True)
class Limits:
    """What commands keep to, each (A,): low, high in the action's unit, rate of change [unit/s], inf for none."""

    low: np.ndarray
    high: np.ndarray
    rate: np.ndarray

    @classmethod
    def of(cls, robot: Robot) -> "Limits":
        """Limits of the actions, of the joints that they move to, and the no-load speed of their drives.

        Raises RobotError where the reset pose, in which episodes begin, lies outside them.
        """
        rates = np.where(targets(robot), _rates(robot, _ports(robot)), np.inf)
        limits = cls(*command_limits(robot).T, rates)
        for a in np.flatnonzero(outside_limits(robot)):
            table = robot.file.actions[a]
            raise RobotError(
                f"{table.name!r} of robot {robot.name!r} is {reset_pose(robot)[a]:g} {table.unit} in the reset pose",
                expected=f"a pose inside its limits, {limits.low[a]:g} to {limits.high[a]:g} {table.unit}",
                do="name a keyframe inside them in [reset] of robot.toml, or correct the range of the action or joint",
            )
        return limits

    def keep(self, actions: np.ndarray, start: np.ndarray, period: float) -> np.ndarray:
        """Commands (T, A) clipped, and slowed down where they change too fast, from `start` (A,) on."""
        actions = np.clip(actions, self.low, self.high)
        if not np.isfinite(self.rate).any():
            return actions
        out, step = np.empty_like(actions), (1.0 - 1e-9) * self.rate * period
        last = np.clip(start, self.low, self.high)
        for t, wanted in enumerate(actions):
            last = out[t] = np.clip(wanted, last - step, last + step)
        return out

    def returned(self, actions: np.ndarray, start: np.ndarray, held: np.ndarray, period: float) -> np.ndarray:
        """Commands (T, A) that `keep` the limits, of which targets `held` (A,) end at `start` (A,).

        They go back in the last fifth of the commands, or begin earlier where their rate does not suffice.
        """
        kept, start = self.keep(actions, start, period), np.clip(start, self.low, self.high)
        steps = max(len(kept) // BACK, 1)
        step = np.minimum((1.0 - 1e-9) * self.rate * period, np.abs(kept - start).max(axis=0) / steps)
        room = step * np.arange(len(kept))[::-1, None]
        return np.where(held, np.clip(kept, start - room, start + room), kept)


@dataclass(frozen=True)
class Span:
    """Where patterns go, each (A,): from the `pose` in which they begin to `below` and `above` their `centre`.

    held : (A,) the targets, which end in the pose again.
    """

    pose: np.ndarray
    held: np.ndarray
    centre: np.ndarray
    below: np.ndarray
    above: np.ndarray

    @classmethod
    def of(cls, robot: Robot, moving: np.ndarray) -> "Span":
        """Patterns about the reset pose; of `moving` (A,) targets that rest near an end, about the middle."""
        pose = reset_pose(robot)
        low, high = command_range(robot, pose).T
        centre = np.where(moving & crowded(robot), (low + high) / 2, pose)
        below, above = np.maximum(INSIDE * (centre - low), 0.0), np.maximum(INSIDE * (high - centre), 0.0)
        return cls(pose, targets(robot), centre, below, above)

    def commands(self, offsets: np.ndarray, limits: Limits, period: float) -> np.ndarray:
        """Commands (T, A) within the limits, of offsets (T, A) from the centre, which are shares of the room there."""
        wanted = self.centre + np.where(offsets > 0, self.above, self.below) * offsets
        return limits.returned(wanted, self.pose, self.held, period)


def crowded(robot: Robot) -> np.ndarray:
    """(A,) targets whose reset pose has no room on one side. None of a robot that stands: it would fall elsewhere."""
    pose = reset_pose(robot)
    low, high = command_range(robot, pose).T
    return (
        targets(robot) & (np.minimum(pose - low, high - pose) < CROWDED * (high - low)) & (not robot.floating)
    )


def joint_range(robot: Robot, channel: str) -> tuple[float, float]:
    """Lowest and highest value of a channel, by its table and its joint's stops; infinite where there is none."""
    (table,) = [c for c in robot.file.channels if c.name == channel]
    low = -np.inf if table.low is None else table.low
    high = np.inf if table.high is None else table.high
    owner, quantity = parts_of(channel)
    names = [robot.model.joint(j).name for j in range(robot.model.njnt)]
    if quantity == "position" and owner in names and robot.model.jnt_limited[names.index(owner)]:
        stops = robot.model.joint(owner).range
        low, high = max(low, stops[0]), min(high, stops[1])
    return float(low), float(high)


def followed(states: np.ndarray, fell: np.ndarray) -> np.ndarray:
    """(E,) the episodes in which no simulator falls or diverges: of states (B, E, T+1, S) and `Rollout.fell` (B, E)."""
    return ((fell >= states.shape[2]) & np.isfinite(states).all(axis=(2, 3))).all(axis=0)


def reached_by(
    robot: Robot, states: np.ndarray, fell: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """(E,) the episodes that are `followed` inside all ranges, and hit no stop; (E, 2, S) their lowest, highest states.

    The states are 0 where a simulator falls or diverges. period : [s] between them.
    """
    usable = followed(states, fell)
    states = np.where(usable[None, :, None, None], states, 0.0)
    reached = np.stack([states.min(axis=(0, 2)), states.max(axis=(0, 2))], axis=1)
    for column, name in enumerate(robot.channels):
        low, high = joint_range(robot, name)
        slack = BEYOND * (high - low) if np.isfinite(high - low) else 0.0
        least, most = reached[:, :, column].T
        usable &= (least >= low - slack) & (most <= high + slack)
        if quantity_of(name) == "position":
            usable &= ~_hits(states[..., column], low, high, period)
    return usable, reached


def _hits(positions: np.ndarray, low: float, high: float, period: float) -> np.ndarray:
    """(E,) where a joint at positions (B, E, T+1) comes to an end of its range faster than `SLOW`.

    A simulated stop may hold within `BEYOND` what comes fast. The speed is that of two steps: the stop may take the
    last one.
    """
    speed, most = np.diff(positions, axis=2, prepend=positions[..., :1]) / period, SLOW * (high - low)
    up, down = (np.maximum(way[..., 1:], way[..., :-1]) > most for way in (speed, -speed))
    return ((up & (positions[..., 1:] >= high)) | (down & (positions[..., 1:] <= low))).any(axis=(0, 2))


def _ports(robot: Robot) -> Ports:
    """The ports of the nominal robot."""
    ports = nominal_ports(robot, 1)
    for parameter, setters in zip(robot.space.parameters, robot.setters, strict=True):
        for assignment in setters:
            if assignment.root in ("port", "control"):
                ports.apply(assignment, np.array([parameter.nominal]))
    return ports


def _rates(robot: Robot, ports: Ports) -> np.ndarray:
    """(A,) no-load speed of each drive, and the control port's largest step a command [unit/s]."""
    drive = {key: value[0] for key, value in ports.drive.items()}
    with np.errstate(divide="ignore", invalid="ignore"):
        servo = drive["supply"] / drive["kt"]
    speed = np.where([t == "duty_servo" for t in ports.types], servo, drive["speed_limit"])
    speed = np.where(is_limit(speed), speed, np.inf)
    return np.minimum(speed, ports.control["max_step"][0] * robot.rate)

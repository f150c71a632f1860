"""Named banks of command sequences that every simulator of a population runs."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from dynreg.rng import stream
from dynreg.sim.layout import layout_of
from dynreg.sim.ports import nominal_ports, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

TYPICAL = 10.0  # Hz, of commands of robots whose control is timed
# Either side of the reset pose, of targets that neither their action nor their joint limits: half a turn and a little.
FREE = {"rad": 3.2, "m": 0.5}
ROUNDED = 1e-3  # of its limits, by which a reset pose may miss them: keyframes are written with few digits
# Each kind draws (steps, A) offsets in [-1, 1] for commands at `rate` Hz.
Kind = Callable[[np.random.Generator, int, int, float], np.ndarray]


def levels(rng: np.random.Generator, steps: int, actions: int, rate: float) -> np.ndarray:
    """Random steps, each joint at times of its own, held for 0.1 to 0.5 s: reaches saturation and limits."""
    out = np.empty((steps, actions))
    for a in range(actions):
        t = 0
        while t < steps:
            hold = max(1, int(rng.uniform(0.1, 0.5) * rate))
            out[t : t + hold, a] = rng.uniform(-1, 1)
            t += hold
    return out


def walk(rng: np.random.Generator, steps: int, actions: int, rate: float) -> np.ndarray:
    """A random walk pulled to zero and smoothed over 0.1 s: rich and gentle."""
    keep = np.exp(-1.0 / (0.4 * rate))
    out, x = np.empty((steps, actions)), np.zeros(actions)
    for t in range(steps):
        x = keep * x + np.sqrt(1 - keep**2) * rng.standard_normal(actions)
        out[t] = 0.5 * x
    return np.clip(out, -1, 1)


def gait(rng: np.random.Generator, steps: int, actions: int, rate: float) -> np.ndarray:
    """One frequency (0.5 to 2.5 Hz) for all joints, random amplitudes and phases: what walking looks like."""
    t = np.arange(steps)[:, None] / rate
    amplitude, phase = rng.uniform(0, 1, actions), rng.uniform(0, 2 * np.pi, actions)
    return amplitude * (
        np.sin(2 * np.pi * rng.uniform(0.5, 2.5) * t + phase) - np.sin(phase) * np.exp(-t / 0.2)
    )


def chirp(rng: np.random.Generator, steps: int, actions: int, rate: float) -> np.ndarray:
    """Sines of rising frequency (0.3 to 4 Hz, at most a fifth of `rate`), a random amplitude for each joint."""
    t = np.arange(steps)[:, None] / rate
    fastest = rate / 5  # five commands a period show a sine
    middle = min(1.0, fastest)
    f0, f1 = rng.uniform(0.3 * middle, middle, actions), rng.uniform(middle, min(4.0, fastest), actions)
    duration = max(steps / rate, 1e-9)
    return rng.uniform(0.2, 1, actions) * np.sin(2 * np.pi * (f0 * t + (f1 - f0) * t**2 / (2 * duration)))


def triangle(rng: np.random.Generator, steps: int, actions: int, rate: float) -> np.ndarray:
    """Slow triangles (period 2 to 4 s): friction without inertia."""
    t = np.arange(steps)[:, None] / rate + rng.uniform(0, 4, actions)
    period = rng.uniform(2, 4, actions)
    return rng.uniform(0.3, 1, actions) * (4 * np.abs(t / period % 1 - 0.5) - 1)


KINDS: Mapping[str, Kind] = MappingProxyType(
    {"levels": levels, "walk": walk, "gait": gait, "chirp": chirp, "triangle": triangle, "drop": levels}
)


def excitation(
    robot: Robot,
    *,
    seed: int,
    name: str = "bank",
    episodes: int = 0,
    steps: int = 0,
    reach: float = 1.0,
    sizes: tuple[float, float] = (0.3, 1.7),
) -> Run:
    """The commands of one bank: depends on the robot, the seed and the name alone.

    Offsets are scaled to `amplitude` times the room between the reset pose and `command_limits`. A "drop"
    holds a random pose and then switches the drives off for the last half. Settings run through their `values`,
    joints of a robot without a floating base start anywhere, optional inputs are drawn once an episode between
    their low and high. `reach` scales how far from the reset pose (and inputs from nominal) all of it goes; `sizes`
    are the least and largest size of an episode, gentle and violent ones: standing robots tell masses and friction,
    violent ones speed and limits.
    """
    file = robot.file.excitation
    episodes, steps = episodes or file.episodes, steps or file.steps
    pose, stops = reset_pose(robot), _stops(robot)
    low, high = command_range(robot, pose).T
    actions = np.empty((episodes, steps, len(robot.actions)))
    inputs = np.tile(robot.input_defaults, (episodes, steps, 1))
    settings = np.empty((episodes, len(robot.settings)))
    initial = np.full((episodes, len(robot.channels)), np.nan)
    held = _held_joints(robot)
    for e in range(episodes):
        kind = file.kinds[e % len(file.kinds)]
        rng = stream(seed, "excitation", robot.name, name, e)
        # the settings change once all kinds had their turn, so that every pair of the two comes up
        for k, setting in enumerate(robot.file.settings):
            choices = setting.values or [setting.nominal]
            settings[e, k] = choices[(e // len(file.kinds)) % len(choices)]
        offset = KINDS[kind](rng, steps, len(robot.actions), robot.file.robot.control_rate or TYPICAL)
        size = reach * file.amplitude * rng.uniform(*sizes)
        centre = pose
        if len(held):
            # a bench may start anywhere: models must know small errors at large angles, as in tracking
            centre = pose + reach * rng.uniform(-0.6, 0.6, len(pose)) * np.minimum(high - pose, pose - low)
        room = np.where(offset > 0, high - centre, centre - low)
        actions[e] = np.clip(centre + size * room * offset, low, high)
        for action, position, velocity in held:
            begin = actions[e, 0, action] + 0.05 * (high - low)[action] * rng.standard_normal()
            initial[e, position] = np.clip(begin, *stops[action])
            if velocity >= 0:
                initial[e, velocity] = 0.3 * (high - low)[action] * rng.standard_normal()
        for i, table in enumerate(robot.file.inputs):
            if table.low is not None and table.high is not None:
                inputs[e, :, i] += reach * (rng.uniform(table.low, table.high) - inputs[e, :, i])
        if kind == "drop":
            actions[e] = actions[e, :1]
            inputs[e, steps // 2 :, len(robot.file.inputs) :] = 0.0
    period = bank_period(robot)
    return Run(
        actions, inputs=inputs, settings=settings, initial=initial if len(held) else None, period=period
    )


def bank_period(robot: Robot) -> float | None:
    """Seconds between commands where none were logged: None for the robot's own rate, which timed control has not."""
    return None if robot.file.robot.control_rate else 1.0 / TYPICAL


def targets(robot: Robot) -> np.ndarray:
    """(A,) whether each action is a target: a position that its drive moves to."""
    return takes_positions(nominal_ports(robot, 1)) if robot.actions else np.zeros(0, dtype=bool)


def reset_pose(robot: Robot) -> np.ndarray:
    """(A,) commands that hold the reset pose: joint positions for position-like drives, else zero."""
    held = targets(robot)
    if not held.any():
        return np.zeros(len(held))
    return np.where(held, robot.start[layout_of(robot).action_qpos], 0.0)


def command_limits(robot: Robot) -> np.ndarray:
    """(A, 2) between which dynreg commands a robot: its action's range and, of a target, its joint's; infinite else.

    A replay keeps to the action's range alone, beyond which the drive takes no command: a log may hold targets beyond
    a joint's stop, with which the drive presses on it.
    """
    ranges, stops = robot.action_ranges, _stops(robot)
    return np.stack([np.maximum(ranges[:, 0], stops[:, 0]), np.minimum(ranges[:, 1], stops[:, 1])], axis=1)


def outside_limits(robot: Robot) -> np.ndarray:
    """(A,) whether the command that holds the reset pose lies outside `command_limits`, by more than is rounded."""
    (low, high), pose = command_limits(robot).T, reset_pose(robot)
    slack = np.where(np.isfinite(high - low), ROUNDED * (high - low), 0.0)
    return (pose < low - slack) | (pose > high + slack)


def _stops(robot: Robot) -> np.ndarray:
    """(A, 2) stops of the joints whose drives take positions; infinite for others."""
    out = np.tile([-np.inf, np.inf], (len(robot.actions), 1))
    held = targets(robot)
    if held.any():
        model = robot.model
        joints = model.dof_jntid[layout_of(robot).action_dof]
        held &= model.jnt_limited[joints] > 0
        out[held] = model.jnt_range[joints[held]]
    return out


def command_range(robot: Robot, pose: np.ndarray) -> np.ndarray:
    """(A, 2) `command_limits`, with `FREE` about the pose (A,) for targets that have none, and 1 for all else."""
    reach = [
        FREE.get(a.unit, 1.0) if held else 1.0
        for a, held in zip(robot.file.actions, targets(robot), strict=True)
    ]
    limits = command_limits(robot)
    usual = pose[:, None] + np.outer(reach, [-1.0, 1.0])
    return np.where(np.isinf(limits), usual, limits)


def _held_joints(robot: Robot) -> list[tuple[int, int, int]]:
    """(action, position column, velocity column or -1) of position-driven joints of a robot without a free base.

    Empty for floating robots, whose joints cannot be put anywhere without moving the base.
    """
    if not robot.actions or robot.floating:
        return []
    channels = {name: i for i, name in enumerate(robot.channels)}
    held = targets(robot)
    return [
        (a, channels[f"{joint}/position"], channels.get(f"{joint}/velocity", -1))
        for a, joint in enumerate(robot.joints)
        if held[a] and f"{joint}/position" in channels
    ]

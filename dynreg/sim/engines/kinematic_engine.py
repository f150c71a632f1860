"""Planar bases in plain numpy: speed and yaw rate follow their commands, the pose is their integral.

rate of speed = (gain command - speed) / lag, the same for the yaw rate; rate of x = speed cos(yaw), rate of
y = speed sin(yaw). The velocities are exact for commands that are held; the pose is a midpoint sum over time
steps.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.errors import RobotError, SimulationError
from dynreg.sim.commands import shaped_commands
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import Acting, acting, configure_terms, observed, on
from dynreg.sim.ports import Ports, nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run

QUANTITIES = ("speed", "yaw_rate", "x", "y", "yaw")
COMMANDS = ("speed_command", "yaw_rate_command")


@dataclass(frozen=True)
class Base:
    """Which of QUANTITIES each channel is (S,), and which of the two velocities each action commands (A,)."""

    channels: np.ndarray
    commands: np.ndarray
    ranges: np.ndarray


def rollout(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Rollout:
    """Simulate B configurations (B, P) through the E episodes of `run`; `threads` changes nothing here.

    Effects may write ports and change what the log holds. Raises RobotError or SimulationError where the robot
    has channels, actions, drives, `sets` or effects that a planar base does not have.
    """
    base = planar_base(robot)
    n = len(values) * run.episodes
    ports = _configured(robot, values, run)
    active = _configured_terms(robot, acting(robot, terms, run.episodes, n), ports)
    period = 1.0 / ports.control["rate"] if run.period is None else np.full(n, run.period)
    period = period * ports.control["clock"]
    # each simulator divides its own period, whatever others are in the batch
    substeps = robot.substeps(period)
    state = _start(base, run, n)
    targets, lag = _targets(base, ports, run, state)
    trace = np.empty((n, run.steps + 1, len(QUANTITIES)))
    trace[:, 0] = state
    for t in range(run.steps):
        _hold(state, targets[:, t], lag, period / substeps, substeps)
        trace[:, t + 1] = state
    shape = (len(values), run.episodes)
    states = observed(robot, active, trace[..., base.channels], ports, period)
    states = states.reshape(*shape, run.steps + 1, -1)
    return Rollout(states, np.full(shape, run.steps + 1), int(substeps.sum()) * run.steps)


def planar_base(robot: Robot) -> Base:
    """Resolve the robot's names: "<base>/speed", yaw_rate, x, y, yaw and the two commands of one base."""
    owners = {name.split("/")[0] for name in (*robot.channels, *robot.actions)}
    if len(owners) != 1:
        raise RobotError(
            f"the names of {robot.name!r} have the prefixes {sorted(owners)}",
            expected="one base, as in 'base/speed' and 'base/speed_command'",
            do="correct the names, or choose another engine",
        )
    channels = [_index(f"channel {name!r}", name, QUANTITIES) for name in robot.channels]
    commands = [_index(f"action {name!r}", name, COMMANDS) for name in robot.actions]
    wrong = [a for a, t in zip(robot.actions, nominal_ports(robot, 1).types, strict=True) if t != "velocity"]
    if wrong:
        raise RobotError(
            f"the drive of action {wrong[0]!r} is not of the kinematic engine",
            expected='type = "velocity"',
            do="correct the drive, or choose another engine",
        )
    ranges = [
        (-np.inf if a.low is None else a.low, np.inf if a.high is None else a.high)
        for a in robot.file.actions
    ]
    return Base(
        np.array(channels, dtype=int),
        np.array(commands, dtype=int),
        np.array(ranges, dtype=float).reshape(-1, 2),
    )


def _index(what: str, name: str, choices: tuple[str, ...]) -> int:
    quantity = name.partition("/")[2]
    if quantity not in choices:
        raise RobotError(
            f"{what} is not of a planar base", expected=f"one of {list(choices)}", do="correct it"
        )
    return choices.index(quantity)


def _configured(robot: Robot, values: np.ndarray, run: Run) -> Ports:
    """Ports of the B E simulations, parameters and settings applied."""
    ports = nominal_ports(robot, len(values)).repeat(run.episodes)
    settings = run.settings
    if settings is None:
        settings = np.tile([s.nominal for s in robot.file.settings], (run.episodes, 1))
    columns = [(a, np.repeat(values[:, i], run.episodes)) for i, s in enumerate(robot.setters) for a in s]
    columns += [
        (a, np.tile(settings[:, i], len(values))) for i, s in enumerate(robot.setting_setters) for a in s
    ]
    for assignment, column in columns:
        if assignment.root not in ("port", "control"):
            raise SimulationError(
                f"sets entry {assignment.text!r}: the kinematic engine has no such field",
                expected="port.drive.gain, port.drive.lag or a control.* key",
                do="correct the entry, or choose another engine",
            )
        ports.apply(assignment, column)
    return ports


def _configured_terms(robot: Robot, active: list[Acting], ports: Ports) -> list[Acting]:
    """The terms, their ports written; SimulationError where one needs masses or moments in between."""

    def expand(field: str) -> np.ndarray:
        raise SimulationError(
            f"an effect changes the model field {field!r}: the kinematic engine has no such field",
            expected="effects on ports or sensors",
            do="choose another engine",
        )

    between = [a for port in ("command", "drive", "friction") for a in on(active, port)]
    if between:
        raise SimulationError(
            f"effect {between[0].effect.id!r} acts on torques and joints: a planar base has none",
            expected="effects on ports or sensors",
            do="choose another engine",
        )
    configure_terms(robot, active, ports, expand)
    return active


def _start(base: Base, run: Run, n: int) -> np.ndarray:
    """(n, 5) QUANTITIES at the start: what is known of the first state, else zero."""
    state = np.zeros((n, len(QUANTITIES)))
    if run.initial is not None:
        state[:, base.channels] = np.nan_to_num(np.tile(run.initial, (n // run.episodes, 1)))
    return state


def _targets(base: Base, ports: Ports, run: Run, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, T, 2) velocities that the commands ask for, (n, 2) lags [s]; zero without a command."""
    n = len(state)
    actions = run.actions.reshape(int(np.prod(run.actions.shape[:-2])), *run.actions.shape[-2:])
    actions = np.tile(actions, (n // len(actions), 1, 1))
    noise = None if run.noise is None else run.noise.reshape(actions.shape)
    low, high = (np.tile(base.ranges[:, i], (n, 1)) for i in (0, 1))
    commands = shaped_commands(actions, state[:, base.commands], low, high, ports, noise)
    targets, lag = np.zeros((n, run.steps, 2)), np.zeros((n, 2))
    targets[..., base.commands] = ports.drive["gain"][:, None] * commands
    lag[:, base.commands] = ports.drive["lag"]
    return targets, lag


def _hold(
    state: np.ndarray, target: np.ndarray, lag: np.ndarray, dt: np.ndarray, substeps: np.ndarray
) -> None:
    """Advance (n, 5) by one command, `substeps` (n,) times dt (n,) [s], in place."""
    fewest = substeps.min()
    for substep in range(int(substeps.max())):
        if substep < fewest:
            _step(state, target, lag, dt)
            continue
        going = substep < substeps  # simulators with shorter periods are done with this command
        rest = state[going]
        _step(rest, target[going], lag[going], dt[going])
        state[going] = rest


def _step(state: np.ndarray, target: np.ndarray, lag: np.ndarray, dt: np.ndarray) -> None:
    """Advance (n, 5) by dt (n,) [s], in place."""
    ratio = dt[:, None] / np.maximum(lag, 1e-12)
    keep = np.exp(-ratio)
    excess = state[:, :2] - target
    travel = target * dt[:, None] + excess * np.maximum(lag, 1e-12) * (1.0 - keep)  # exact integral
    state[:, :2] = target + excess * keep
    heading = state[:, 4] + 0.5 * travel[:, 1]
    state[:, 2] += travel[:, 0] * np.cos(heading)
    state[:, 3] += travel[:, 0] * np.sin(heading)
    state[:, 4] += travel[:, 1]

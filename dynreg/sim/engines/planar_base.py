"""What the engines of planar bases share: commands on their way to the wheels, pose, encoders, effects.

An engine says how velocities go on in one time step and what becomes of the pose. What the wheels do is one thing,
what the base does on the ground another: effects of contact lie between. Arrays are (quantity, simulation) here.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.commands import shaped_commands
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import (
    Acting,
    Clock,
    acting,
    clock_of,
    commanded,
    configure_terms,
    observed,
    on,
    true_states,
)
from dynreg.sim.engines.planar_names import ON_WHEELS, QUANTITIES, Base, planar_base
from dynreg.sim.ports import Ports, assigned, nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated


@dataclass(frozen=True)
class Law:
    """lag v' = target - drag v + coupling, of n simulations: lag, drag (2, n) of speed and yaw rate.

    centrifugal : (n,) times yaw rate squared, on the speed. coupling : (n,) times speed and yaw rate, against the yaw
    rate.
    """

    lag: np.ndarray
    drag: np.ndarray
    centrifugal: np.ndarray
    coupling: np.ndarray


class Integrator(Protocol):
    """How an engine takes one time step h (n,) [s]."""

    def longest(self, law: Law, h: np.ndarray) -> np.ndarray:
        """(n,) time steps that it can take, at most h."""

    def advance(
        self, velocity: np.ndarray, target: np.ndarray, law: Law, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(2, n) velocities after the time step, their mean in it, and (..., 2, n) what `displace` takes."""

    def displace(self, yaw: np.ndarray, stages: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, ...]:
        """(n,) changes of x, y and yaw."""


def planar_rollout(
    robot: Robot,
    values: np.ndarray,
    run: Run,
    terms: Terms | None,
    integrator: Integrator,
) -> Simulated:
    """N simulations, each of parameters (N, P) and an episode of `run` of its own.

    Effects may change ports, commands, the contact of wheels and what the log holds. Raises RobotError or
    SimulationError where the robot has channels, actions, drives, `sets` or effects that a planar base does not have.
    """
    base = planar_base(robot)
    active = acting(robot, terms)
    ports = _configured(robot, values, run, active)
    period, begin = clock_of(ports, run)
    law = _law(base, ports)
    # each simulator divides its own period, whatever others are in the batch
    substeps = robot.substeps(period)
    h = period / substeps
    substeps = substeps * np.ceil(h / integrator.longest(law, h) - 1e-9).astype(int)
    state = _start(robot, base, run, ports, law, period)
    before = None if run.before is None else np.clip(run.before, *base.ranges.T)
    told = _commands(base, ports, run, state)
    clock = Clock(told, period, period / substeps, begin, run.draws, before)
    motion = _Motion(base, ports, law, clock, active, integrator)
    trace = np.empty((run.steps + 1, *state.shape))
    trace[0] = state
    for t in range(run.steps):
        state = trace[t + 1] = motion.hold(state, t)
    states = observed(robot, active, _channels(base, ports, trace), ports, period)
    return Simulated(states, np.full(len(values), run.steps + 1), substeps * run.steps)


class _Motion:
    """A batch in motion: states (7, n) are QUANTITIES and the angles of both wheels."""

    def __init__(
        self,
        base: Base,
        ports: Ports,
        law: Law,
        clock: Clock,
        active: list[Acting],
        integrator: Integrator,
    ):
        self.base, self.ports, self.law, self.clock, self.integrator = base, ports, law, clock, integrator
        self.commanding, self.rolling = on(active, "command"), on(active, "roll")
        self.most = int(clock.substeps.max())
        for a in active:
            a.moment.speeds = True
        clock.show(active)

    def hold(self, state: np.ndarray, step: int) -> np.ndarray:
        """(7, n) after command number `step`."""
        self.clock.step = step
        u = self.clock.commands[:, step]
        target = _asked(self.base, self.ports, u)
        for substep in range(self.most):
            self.clock.substep = substep
            if self.commanding:
                told = commanded(self.commanding, u, *self._measured(state), self.clock)
                target = _asked(self.base, self.ports, told)
            after = self._step(state, target)
            done = self.clock.done(slice(None))  # simulators with shorter periods wait
            state = after if done is None else np.where(done[:, 0], state, after)
        return state

    def _measured(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, A) what each drive measures of the speed that it is to give, twice: nothing is faster than a speed."""
        true = _wheel_speeds(self.ports, *state[:2]) if self.base.wheels else state[:2]
        read = self.ports.sensor["scale"] * true[self.base.commands].T
        return read, read

    def _step(self, state: np.ndarray, target: np.ndarray) -> np.ndarray:
        h = self.clock.h
        after = np.empty_like(state)
        after[:2], mean, stages = self.integrator.advance(state[:2], target, self.law, h)
        ground = stages + self._slip(state[:2], mean, after[:2]) if self.rolling else stages
        after[2], after[3], after[4] = self.integrator.displace(state[4], ground, h)
        after[2:5] += state[2:5]
        after[5:] = state[5:]
        if self.base.wheels:
            after[5:] += _wheel_speeds(self.ports, *mean) * h
        return after

    def _slip(self, before: np.ndarray, mean: np.ndarray, after: np.ndarray) -> np.ndarray:
        """(2, n) by how much the base's mean velocities over the ground differ from those (2, n) of its wheels."""
        radius, order = self.ports.base["wheel_radius"], self.base.commands
        first, turning, last = (
            (radius * _wheel_speeds(self.ports, *velocities))[order].T for velocities in (before, mean, after)
        )
        rolled = turning.copy()
        for a in self.rolling:
            x = a.see(v=first, q=last)
            rolled[a.where] = a.ask(a.effect.roll, self.clock, rolled[a.where], x)
        lost = np.zeros_like(before)
        lost[order] = (rolled - turning).T
        return _base_velocities(*lost, self.ports.base["track"])


def _configured(robot: Robot, values: np.ndarray, run: Run, active: list[Acting]) -> Ports:
    """Ports of the simulations after parameters, settings and terms.

    SimulationError where one of them needs masses, or moments in between.
    """
    ports = nominal_ports(robot, len(values))
    for assignment, column in assigned(robot, values, run):
        if assignment.root not in ("port", "control"):
            raise SimulationError(
                f"sets entry {assignment.text!r}: a planar base has no such field",
                expected="port.drive.gain, port.drive.lag, a port.base.* or a control.* key",
                do="correct the entry, or choose another engine",
            )
        ports.apply(assignment, column)

    def expand(field: str) -> np.ndarray:
        raise SimulationError(
            f"an effect changes the model field {field!r}: a planar base has no such field",
            expected="effects on ports, commands, wheels or sensors",
            do="choose another engine",
        )

    between = [a for port in ("drive", "friction") for a in on(active, port)]
    if between:
        raise SimulationError(
            f"effect {between[0].effect.id!r} acts on torques and joints: a planar base has none",
            expected="effects on ports, commands, wheels or sensors",
            do="choose another engine",
        )
    configure_terms(robot, active, ports, expand)
    return ports


def _law(base: Base, ports: Ports) -> Law:
    n = len(ports.control["clock"])
    drives = ports.drive["lag"]
    if base.wheels:
        b = ports.base
        more = drives.mean(axis=1) if drives.shape[1] else 0.0
        lag = np.stack([b["speed_lag"] + more, b["yaw_lag"] + more])
        drag = np.stack([b["speed_drag"], b["yaw_drag"]])
        return Law(lag, drag, b["centrifugal"], b["coupling"])
    lag = np.zeros((2, n))
    lag[base.commands] = drives.T
    return Law(lag, np.ones((2, n)), np.zeros(n), np.zeros(n))


def _start(robot: Robot, base: Base, run: Run, ports: Ports, law: Law, period: np.ndarray) -> np.ndarray:
    """(7, n) states at the start: what is known of the first one, else zero."""
    n = len(period)
    state = np.zeros((len(QUANTITIES) + 2, n))
    if run.initial is None:
        return state
    full = np.full((len(QUANTITIES) + len(ON_WHEELS), n), np.nan)
    full[base.channels] = true_states(robot, run.initial, ports).T
    speeds = len(QUANTITIES) + 2 + np.arange(2)
    if base.wheels and np.isin(speeds, base.channels).all() and not np.isin((0, 1), base.channels).any():
        radius = ports.base["wheel_radius"]
        full[:2] = _base_velocities(*(radius * full[speeds]), ports.base["track"])
    if run.velocity is not None:
        full[:2] = np.where(np.isnan(full[:2]), run.velocity.T, full[:2])
    if run.before is not None:
        came = _velocities_after(base, ports, law, np.nan_to_num(run.before), period)
        full[:2] = np.where(np.isnan(full[:2]), came, full[:2])
    return np.nan_to_num(full[: len(state)])


def _velocities_after(
    base: Base, ports: Ports, law: Law, commands: np.ndarray, period: np.ndarray
) -> np.ndarray:
    """(2, n) speed and yaw rate after commands (n, L, A), each held for `period` (n,) [s], from standstill.

    In closed form: without what couples both velocities in the unicycle, effects, and a largest step of commands.
    """
    told = np.clip(commands, *base.ranges.T)
    with np.errstate(divide="ignore"):
        stays = np.exp(-law.drag * period / law.lag)  # (2, n), 0 without a lag
    weights = ((1.0 - stays) / law.drag)[..., None] * stays[..., None] ** np.arange(told.shape[1])[::-1]
    # what a velocity is made of, each its own
    sums = (np.einsum("nl,nla->na", axis, told) for axis in weights)
    return np.stack([_asked(base, ports, one)[i] for i, one in enumerate(sums)])


def _commands(base: Base, ports: Ports, run: Run, state: np.ndarray) -> np.ndarray:
    """(n, T, A) commands within their ranges and largest steps."""
    n = state.shape[1]
    low, high = (np.tile(base.ranges[:, i], (n, 1)) for i in (0, 1))
    moving = _wheel_speeds(ports, *state[:2]) if base.wheels else state[:2]
    return shaped_commands(run.actions, moving[base.commands].T, low, high, ports, run.noise)


def _asked(base: Base, ports: Ports, commands: np.ndarray) -> np.ndarray:
    """(2, n) velocities that commands (n, A) ask of the base; zero without a command.

    Wheels are driven to what their encoders read.
    """
    gain = (ports.drive["gain"] * ports.drive["gain_factor"] / ports.sensor["scale"]).T
    asked = np.zeros((2, len(commands)))
    asked[base.commands] = gain * commands.T
    if not base.wheels:
        return asked
    return _base_velocities(*(ports.base["wheel_radius"] * asked), ports.base["track"])


def _base_velocities(left: np.ndarray, right: np.ndarray, track: np.ndarray) -> np.ndarray:
    """(2, n) speed and yaw rate of a base whose wheels move at (n,) `left` and `right` [m/s]."""
    out = np.empty((2, len(left)))
    out[0], out[1] = (left + right) / 2.0, (right - left) / track
    return out


def _wheel_speeds(ports: Ports, speed: np.ndarray, yaw_rate: np.ndarray) -> np.ndarray:
    """(2, ..., n) [rad/s] of the left and the right wheel, from (..., n) velocities of the base."""
    radius, turn = ports.base["wheel_radius"], yaw_rate * (ports.base["track"] / 2.0)
    out = np.empty((2, *speed.shape))
    out[0], out[1] = (speed - turn) / radius, (speed + turn) / radius
    return out


def _channels(base: Base, ports: Ports, trace: np.ndarray) -> np.ndarray:
    """(n, T+1, S) channels of states (T+1, 7, n)."""
    if base.wheels:
        speeds = _wheel_speeds(ports, trace[:, 0], trace[:, 1])
        trace = np.concatenate([trace, np.moveaxis(speeds, 0, 1)], axis=1)
    return np.ascontiguousarray(np.moveaxis(trace[:, base.channels], 2, 0))

"""How the mujoco engine holds a command: many time steps at once, one at a time where something acts in between."""

import copy

import numpy as np
from mujoco.batch import Batch

from dynreg.sim.engines.acting import (
    Acting,
    Clock,
    Trail,
    ahead,
    bound,
    commanded,
    driven,
    fed_back,
    has_sensors,
    on,
    prepare,
)
from dynreg.sim.engines.alone import Alone
from dynreg.sim.engines.joint_kernel import SETTLED
from dynreg.sim.layout import Layout, filters
from dynreg.sim.ports import Ports, ServoLaw, slice_of

BETWEEN = (
    "feedback",
    "command",
    "encoder",
    "drive",
    "friction",
)  # the ports that are called between time steps
SLOW = 0.02  # rad/s (m/s) below which dry friction may hold with less than its bound


class Drives:
    """The model fields that servo laws are written into, with the model's own damping and friction underneath.

    law : the one in force. plain, friction : (n, A) dry friction without and with effects [N m].
    """

    def __init__(self, batch: Batch, layout: Layout, ports: Ports):
        self._at = slice_of(layout.action_actuator)
        self._dof = slice_of(layout.action_dof)
        self._write_to(batch)
        self._viscous = self._damping[:, self._dof] + ports.friction["viscous"]
        self.plain = self._friction[:, self._dof] + ports.friction["coulomb"]
        self.rub(self.plain)

    def on(self, batch: Batch | Alone) -> "Drives":
        """The same drives, written into another batch, whose model fields hold what these fields hold now."""
        moved = copy.copy(self)
        moved._write_to(batch)
        return moved

    def _write_to(self, batch: Batch | Alone) -> None:
        self._gain, self._bias = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
        self._range = batch.expand("actuator_forcerange")
        self._damping, self._friction = batch.expand("dof_damping"), batch.expand("dof_frictionloss")

    def apply(self, law: ServoLaw) -> None:
        """Let every drive follow `law` from here on."""
        self.law = law
        self._gain[:, self._at, 0] = law.gain
        self._bias[:, self._at, 0] = law.bias
        self._bias[:, self._at, 1] = -law.stiffness
        self._bias[:, self._at, 2] = -law.rate
        self._range[:, self._at, 0] = -law.limit
        self._range[:, self._at, 1] = law.limit
        self._damping[:, self._dof] = self._viscous + law.damping

    def rub(self, friction: np.ndarray) -> None:
        """Set the dry friction (n, A) of the driven joints [N m]."""
        self.friction = friction
        self._friction[:, self._dof] = friction

    def torque(
        self, u: np.ndarray, q: np.ndarray, v: np.ndarray, turning: np.ndarray | None = None
    ) -> np.ndarray:
        """(n, A) torque that the drives give for commands u where their loops see q, v, damping left out.

        turning : (n, A) speed that their motors turn at; v without it.
        """
        law = self.law
        return law.limited(
            law.gain * u + law.bias - law.stiffness * q - law.rate * v, v if turning is None else turning
        )

    def fade(self, v: np.ndarray) -> None:
        """Let every drive give no more than it can at speeds v (n, A)."""
        self._range[:, self._at, 0], self._range[:, self._at, 1] = self.law.bounds(v)


class Steps:
    """Advances a batch by one command. Simulations without effects in between take all their time steps at once.

    clock : the commands (n, T, A) and where the rollout is in them. busy : numbers of the other simulations.
    """

    def __init__(self, batch: Batch | Alone, layout: Layout, drives: Drives, clock: Clock, busy: np.ndarray):
        self._batch, self._drives, self.clock = batch, drives, clock
        self._ctrl, self._actuators = batch.bind("ctrl"), slice_of(layout.action_actuator)
        self._idle = np.setdiff1d(np.arange(batch.nsim), busy)
        self._groups = self._grouped(self._idle)

    def hold(self, step: int) -> None:
        """Advance every simulation to the end of command number `step`."""
        self._ctrl[:, self._actuators] = self.clock.commands[:, step]
        for group, count in self._groups:
            self._step(group, count)

    def read(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, nq) and velocities (n, nv) as the log has them: with joints where their encoders stand."""
        return q, v

    def keep(self, standing: np.ndarray) -> None:
        """Advance only these simulations, (n,) flags, from here on."""
        self._groups = self._grouped(self._idle[standing[self._idle]])

    def _grouped(self, idle: np.ndarray) -> list[tuple[np.ndarray, int]]:
        counts = self.clock.substeps[idle]
        return [(idle[counts == count], int(count)) for count in np.unique(counts)]

    def _step(self, simulations: np.ndarray, count: int) -> None:
        whole = len(simulations) == self._batch.nsim
        self._batch.step(ids=None if whole else simulations, nstep=count)


class EffectSteps(Steps):
    """Steps with effects on commands, drives and friction: they act before every time step of their simulations.

    Where a drive's torque changes, the difference to its law is applied to the joint, so that the actuator keeps
    its implicit integration. Biases and contact forces are those of the state before the last time step, as MuJoCo
    leaves them: late by one time step, which is the order of the integrator's own error.
    """

    def __init__(
        self,
        batch: Batch | Alone,
        layout: Layout,
        drives: Drives,
        clock: Clock,
        busy: np.ndarray,
        active: list[Acting],
        ports: Ports,
        inertia: np.ndarray,
    ):
        super().__init__(batch, layout, drives, clock, busy)
        self._busy, self._counts = busy, clock.substeps[busy]
        self._active, self._ports, self._inertia = active, ports, inertia
        self._feeding, self._commanding, self._apart, self._driving, self._rubbing = (
            on(active, port) for port in BETWEEN
        )
        self._trail = Trail(clock, len(layout.action_dof)) if self._feeding else None
        self._ahead, self._faster, self._asked = 0.0, 0.0, 0.0
        self._begun = False
        self._sensed, self._law = has_sensors(ports), None
        self._qpos, self._qvel = batch.bind("qpos"), batch.bind("qvel")
        self._position, self._dof = slice_of(layout.action_qpos), slice_of(layout.action_dof)
        self._applied = batch.bind("qfrc_applied")
        self._bias, self._constraint = batch.bind("qfrc_bias"), batch.bind("qfrc_constraint")
        self._spring, self._springs = batch.bind("qfrc_spring"), batch.expand("jnt_stiffness").any()
        self._constraints, self._dry = batch.bind("nefc"), batch.bind("nf")
        self._filtered, self._holds = filters(batch.model, layout)
        self._activation = batch.bind("act")
        batch.forward(ids=busy)  # the forces before the first time step

    def read(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not self._apart:
            return q, v
        q, v = q.copy(), v.copy()
        q[:, self._position] += self._ahead
        v[:, self._dof] += self._faster
        return q, v

    def keep(self, standing: np.ndarray) -> None:
        super().keep(standing)
        self._counts = np.where(standing[self._busy], self._counts, 0)

    def hold(self, step: int) -> None:
        super().hold(step)
        self.clock.step = step
        if self._law is not self._drives.law:
            self._law = self._drives.law
            prepare(self._active, self._law, self._inertia, self.clock)
        together = int(self._counts.min())
        for substep in range(int(self._counts.max())):
            self.clock.substep = substep
            self._act(self.clock.commands[:, step])
            self._step(self._busy if substep < together else self._busy[self._counts > substep], 1)
            if self._apart:
                q, v = self._qpos[:, self._position], self._qvel[:, self._dof]
                self._ahead, self._faster = ahead(self._apart, self._asked, q, v, self.clock)

    def _act(self, u: np.ndarray) -> None:
        """Let the effects act at the present state."""
        q, v = self._qpos[:, self._position].copy(), self._qvel[:, self._dof].copy()
        if self._law.fading:
            self._drives.fade(v)
        seen, speed = (q + self._ahead, v + self._faster) if self._apart else (q, v)
        if self._feeding:
            self._trail.keep(seen, speed, self.clock)
            seen, speed = fed_back(self._feeding, seen, speed, self._trail, self.clock)
        if self._commanding:
            sensor = self._ports.sensor
            measured = sensor["scale"] * (seen + sensor["offset"]) if self._sensed else seen
            u = commanded(self._commanding, u, measured, speed, self.clock)
            self._ctrl[:, self._actuators] = u
        if not (self._feeding or self._apart or self._driving or self._rubbing):
            return
        if len(self._filtered):  # such a drive follows what its filter holds
            u = u.copy()
            u[:, self._filtered] = self._activation[:, self._holds]
        asked = self._drives.torque(u, seen, speed, v)
        if self._apart and not self._begun:
            q, v = self._settle(asked, q, v)
        self._asked, self._begun = asked, True
        plain, load = self._drives.torque(u, q, v), self._load(v)
        torque = driven(self._driving, asked, q, v, load, self.clock)
        if self._driving or self._feeding or self._apart:
            self._applied[:, self._dof] = torque - plain
        if self._rubbing:
            net = torque - self._law.damping * v  # what the gear carries: a motor's back-EMF takes its share
            friction = bound(self._rubbing, self._drives.plain, net, q, v, load, self.clock)
            # where the command is done already, the constraint forces belong to the friction before
            done = self.clock.done(slice(None))
            self._drives.rub(friction if done is None else np.where(done, self._drives.friction, friction))

    def _settle(self, torque: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, A), (n, A) where the joints are whose encoders say q and v; they are moved there."""
        joint, speed = q, v
        for _ in range(SETTLED):
            self._ahead, self._faster = ahead(self._apart, torque, joint, speed, self.clock)
            joint, speed = q - self._ahead, v - self._faster
        self._qpos[:, self._position], self._qvel[:, self._dof] = joint, speed
        moved = np.zeros(len(q), dtype=bool)
        for a in self._apart:
            moved[a.rows] = True
        self._batch.forward(ids=np.flatnonzero(moved))
        return joint, speed

    def _load(self, v: np.ndarray) -> np.ndarray:
        """(n, A) torque that would hold the joints: against gravity, springs, what the ground and the stops push."""
        bias, constraint = self._bias[:, self._dof], self._constraint[:, self._dof]
        load = bias - self._spring[:, self._dof] if self._springs else bias.copy()
        pushed = self._constraints > self._dry
        if pushed.any():
            # the same sum holds the joint's own dry friction, which the gear's load side does not feel
            push = np.minimum(np.maximum(v / SLOW, -1.0), 1.0)
            push *= self._drives.friction
            push += constraint
            load -= push if pushed.all() else np.where(pushed[:, None], push, 0.0)
        return load


def busy_simulations(active: list[Acting], law: ServoLaw) -> np.ndarray:
    """Numbers of the simulations with something to do between time steps: effects, and drives that fade with speed."""
    busy = (law.fade != 0.0).any(axis=1)
    for port in BETWEEN:
        for a in on(active, port):
            busy[a.rows] = True
    return np.flatnonzero(busy)

"""Independent joints in plain numpy over candidates: servo benches, legs in the air, an arm joint by joint.

Each driven joint moves alone, the others held where they start: inertia and gravity load come from the same
MuJoCo model and the same `sets` as in the mujoco engine, so one robot folder serves both.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import (
    Acting,
    Clock,
    acting,
    bound,
    clock_of,
    commanded,
    configure_terms,
    driven,
    has_sensors,
    observed,
    on,
    on_drives,
    prepare,
    true_states,
)
from dynreg.sim.engines.mujoco_model import compiled, configure, episode_inputs, joint_inertia, told
from dynreg.sim.layout import Layout, observe, place
from dynreg.sim.ports import Ports, ServoLaw, law_changes, servo_law
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated


@dataclass(frozen=True)
class Plant:
    """(n, A) constants of each driven joint: I qdd = torque - load(q) - friction, load = a sin(q + b) + c.

    inertia [kg m^2 or kg], viscous [N m s/rad], coulomb [N m]; the load is exact for one hinge.
    """

    inertia: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    constant: np.ndarray

    @cached_property
    def _swings(self) -> bool:
        return bool(self.amplitude.any())

    def take(self, drives: np.ndarray) -> "Plant":
        """Only these drives (numbers)."""
        return Plant(*(np.ascontiguousarray(getattr(self, f.name)[:, drives]) for f in fields(self)))

    def load(self, q: np.ndarray) -> np.ndarray:
        """(n, A) gravity and spring torque at positions q."""
        if not self._swings:
            return self.constant
        return self.amplitude * np.sin(q + self.phase) + self.constant


def simulate(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Simulated:
    """N simulations, each of parameters (N, P) and an episode of `run` of its own, every joint alone."""
    model, layout = compiled(robot)
    _check(robot, layout)
    batch = Batch(model, len(values), nthread=threads)
    ports = configure(robot, batch, model, values, run)
    active = acting(robot, terms)
    configure_terms(robot, active, ports, batch.expand)
    batch.set_const()
    inputs = episode_inputs(robot, run)
    q, v = _start(robot, layout, batch, run, ports)
    plant = _plant(batch, model, layout, ports)
    period, begin = clock_of(ports, run)
    # each simulator divides its own period, whatever others are in the batch
    substeps = robot.substeps(period)
    commands = told(layout, model, batch, ports, run, q)
    clock = Clock(commands, period, period / substeps, begin)
    drives = np.array(robot.drives_of(run.joints), dtype=int)
    clock.commands = np.ascontiguousarray(commands[..., drives])
    clock.draws = None if run.draws is None else run.draws[..., drives]
    motion = _Motion(ports.take(drives), plant.take(drives), inputs, on_drives(active, drives), clock)
    positions, velocities = motion.integrate(q[:, drives], v[:, drives], substeps)
    # whole poses, of which the joints that are left out are not known
    qpos, qvel = (np.full((batch.nsim, run.steps + 1, size), np.nan) for size in (model.nq, model.nv))
    qpos[..., layout.action_qpos[drives]] = np.swapaxes(positions, 0, 1)
    qvel[..., layout.action_dof[drives]] = np.swapaxes(velocities, 0, 1)
    states = observe(layout, qpos, qvel, len(robot.channels))
    states = observed(robot, active, states, ports, period)
    return Simulated(states, np.full(len(values), run.steps + 1), substeps * run.steps)


class _Motion:
    """Leapfrog: half a step of position, a step of velocity, half a step of position; second order, and stable.

    Damping is the mean of before and after. Dry friction is the impulse that stops the joint, at most its bound
    (exact for one joint: it neither creeps nor chatters). A first-order step would move the joint half a time
    step early, and a diagnosis would blame a cause for it.
    """

    def __init__(self, ports: Ports, plant: Plant, inputs: np.ndarray, active: list[Acting], clock: Clock):
        self.ports, self.plant, self.inputs, self.clock = ports, plant, inputs, clock
        self.active = active
        self.commanding, self.driving, self.rubbing = (
            on(active, k) for k in ("command", "drive", "friction")
        )
        self.sensed = has_sensors(ports)
        self.h = clock.h[:, None]
        self.half = 0.5 * self.h

    def integrate(self, q: np.ndarray, v: np.ndarray, substeps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T+1, n, A) positions and velocities from (n, A), with the substeps (n,) of each simulation."""
        clock = self.clock
        steps = clock.commands.shape[1]
        positions = np.empty((steps + 1, *q.shape))
        velocities = np.empty((steps + 1, *q.shape))
        positions[0], velocities[0] = q, v
        changed = law_changes(self.ports, self.inputs)
        fewest, going = int(substeps.min()), np.arange(substeps.max()) < substeps[:, None]
        for t in range(steps):
            clock.step = t
            if t == 0 or t in changed:
                self._obey(servo_law(self.ports, self.inputs[:, t]))
            u = clock.commands[:, t]
            push = self.law.gain * u + self.law.bias
            for substep in range(int(substeps.max())):
                clock.substep = substep
                half = q + self.half * v
                after = self._advance(push, u, half, v)
                ahead = half + self.half * after
                if substep >= fewest:  # simulators with shorter periods are done with this command
                    after = np.where(going[:, substep, None], after, v)
                    ahead = np.where(going[:, substep, None], ahead, q)
                q, v = ahead, after
            positions[t + 1], velocities[t + 1] = q, v
        return positions, velocities

    def _obey(self, law: ServoLaw) -> None:
        self.law, self.lowest = law, -law.limit
        damping = self.h * (self.plant.viscous + law.damping)
        after = np.where(damping < self.plant.inertia, 0.5, 1.0)  # very strong damping: all of it afterwards
        self.drag = self.plant.inertia + after * damping
        self.kept = self.plant.inertia - (1.0 - after) * damping
        self.stop = self.h * self.plant.coulomb / self.drag
        prepare(self.active, law, self.plant.inertia, self.clock)

    def _advance(self, push: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(n, A) velocities one time step on."""
        law = self.law
        if self.commanding:
            measured = q
            if self.sensed:
                measured = self.ports.sensor["scale"] * (q + self.ports.sensor["offset"])
            push = law.gain * commanded(self.commanding, u, measured, v, self.clock) + law.bias
        torque = np.minimum(np.maximum(push - law.stiffness * q - law.rate * v, self.lowest), law.limit)
        load = self.plant.load(q)
        torque = driven(self.driving, torque, q, v, load, self.clock)
        stop = self.stop
        after = (self.kept * v + self.h * (torque - load)) / self.drag
        if self.rubbing:
            net = torque - law.damping * v  # what the gear carries: a motor's back-EMF takes its share
            friction = bound(self.rubbing, self.plant.coulomb, net, q, v, load, self.clock)
            stop = self.h * friction / self.drag
        return after - np.minimum(np.maximum(after, -stop), stop)  # what is left beyond what friction stops


def _plant(batch: Batch, model: mujoco.MjModel, layout: Layout, ports: Ports) -> Plant:
    """Inertia and load of each driven joint, from MuJoCo's own bias force at three positions of that joint."""
    qpos, bias = batch.bind("qpos"), batch.bind("qfrc_bias")
    batch.bind("qvel")[:] = 0.0  # of the pose alone
    rest = qpos.copy()
    shape = (batch.nsim, len(layout.action_qpos))
    sine, cosine, constant = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for a, (at, dof) in enumerate(zip(layout.action_qpos, layout.action_dof, strict=True)):
        hinge = model.jnt_type[model.dof_jntid[dof]] == mujoco.mjtJoint.mjJNT_HINGE
        loads = []
        for angle in (0.0, np.pi / 2, np.pi):
            qpos[:] = rest
            qpos[:, at] = angle if hinge else rest[:, at]
            batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
            loads.append(bias[:, dof].copy())
        constant[:, a] = (loads[0] + loads[2]) / 2
        sine[:, a] = loads[1] - constant[:, a]
        cosine[:, a] = (loads[0] - loads[2]) / 2
    qpos[:] = rest
    inertia = joint_inertia(batch, model, layout)
    damping = batch.expand("dof_damping")[:, layout.action_dof] + ports.friction["viscous"]
    friction = batch.expand("dof_frictionloss")[:, layout.action_dof] + ports.friction["coulomb"]
    return Plant(inertia, damping, friction, np.hypot(sine, cosine), np.arctan2(cosine, sine), constant)


def _start(
    robot: Robot, layout: Layout, batch: Batch, run: Run, ports: Ports
) -> tuple[np.ndarray, np.ndarray]:
    batch.reset(keyframe=robot.keyframe)
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    qvel[:] = 0.0
    if run.initial is not None:
        place(layout, true_states(robot, run.initial, ports), qpos, qvel)
    return qpos[:, layout.action_qpos].copy(), qvel[:, layout.action_dof].copy()


def _check(robot: Robot, layout: Layout) -> None:
    undriven = set(layout.position[1]) - set(layout.action_qpos) | set(layout.velocity[1]) - set(
        layout.action_dof
    )
    if len(layout.base[0]) or undriven:
        raise SimulationError(
            f"robot {robot.name!r} has channels of joints that no action drives",
            expected="one driven joint for each channel: the joint engine moves every joint alone",
            do="use the mujoco engine for this robot",
        )

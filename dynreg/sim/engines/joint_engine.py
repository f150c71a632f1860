"""Independent joints in plain numpy over candidates: servo benches, legs in the air, an arm joint by joint.

Each driven joint moves alone, the others held at the reset pose: inertia and gravity load come from the same
MuJoCo model and the same `sets` as in the mujoco engine, so one robot folder serves both.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.errors import SimulationError
from dynreg.sim.commands import shaped_commands
from dynreg.sim.engines.mujoco_engine import compiled, configure, episode_inputs, limited_range
from dynreg.sim.layout import Layout
from dynreg.sim.ports import Ports, servo_law, takes_positions, varies
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run


@dataclass(frozen=True)
class Plant:
    """(n, A) constants of each driven joint: I qdd = torque - load(q) - friction, load = a sin q + b cos q + c.

    inertia [kg m^2 or kg], viscous [N m s/rad], coulomb [N m]; the load is exact for one hinge.
    """

    inertia: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    sine: np.ndarray
    cosine: np.ndarray
    constant: np.ndarray

    def load(self, q: np.ndarray) -> np.ndarray:
        """(n, A) gravity and spring torque at positions q."""
        return self.sine * np.sin(q) + self.cosine * np.cos(q) + self.constant


def rollout(robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0) -> Rollout:
    """Simulate B configurations (B, P) through the E episodes of `run`, every joint alone."""
    model, layout = compiled(robot)
    _check(robot, layout)
    n, episodes = len(values), run.episodes
    batch = Batch(model, n * episodes, nthread=threads)
    ports = configure(robot, batch, model, values, run)
    batch.set_const()
    plant = _plant(batch, model, layout, ports)
    inputs = episode_inputs(robot, n, run)
    q, v = _start(robot, layout, batch, run, n)
    period = 1.0 / ports.control["rate"] if run.period is None else np.full(batch.nsim, run.period)
    # each simulator divides its own period, whatever others are in the batch
    substeps = np.maximum(np.ceil(period / robot.file.robot.timestep - 1e-9), 1).astype(int)
    commands = _commands(layout, model, batch, ports, run, q)
    positions, velocities = _integrate(ports, plant, commands, inputs, q, v, period / substeps, substeps)
    states = _observe(robot, layout, positions, velocities)
    shape = (n, episodes)
    fell = np.full(shape, run.steps + 1)
    return Rollout(states.reshape(*shape, run.steps + 1, -1), fell, int(substeps.sum()) * run.steps)


def _integrate(
    ports: Ports,
    plant: Plant,
    commands: np.ndarray,
    inputs: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    dt: np.ndarray,
    substeps: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Semi-implicit Euler with implicit damping, as MuJoCo's implicitfast; Coulomb friction as the impulse
    that stops the joint, at most its bound (exact for one joint: it neither creeps nor chatters)."""
    steps = commands.shape[1]
    positions = np.empty((steps + 1, *q.shape))
    velocities = np.empty((steps + 1, *q.shape))
    positions[0], velocities[0] = q, v
    h = dt[:, None]
    changing = varies(ports)
    fewest, going = int(substeps.min()), np.arange(substeps.max()) < substeps[:, None]
    for t in range(steps):
        if t == 0 or changing:
            law = servo_law(ports, inputs[:, t])
            drag = plant.inertia + h * (plant.viscous + law.damping)
            stop = h * plant.coulomb / drag
            push = law.gain * commands[:, t]
        else:
            push = law.gain * commands[:, t]
        for substep in range(int(substeps.max())):
            torque = np.clip(push - law.stiffness * q - law.rate * v, -law.limit, law.limit)
            after = (plant.inertia * v + h * (torque - plant.load(q))) / drag
            after = np.sign(after) * np.maximum(np.abs(after) - stop, 0.0)
            if substep >= fewest:  # simulators with shorter periods are done with this command
                after = np.where(going[:, substep, None], after, v)
                q = np.where(going[:, substep, None], q + h * after, q)
            else:
                q = q + h * after
            v = after
        positions[t + 1], velocities[t + 1] = q, v
    return positions, velocities


def _plant(batch: Batch, model: mujoco.MjModel, layout: Layout, ports: Ports) -> Plant:
    """Inertia and load of each driven joint, from MuJoCo's own bias force at three positions of that joint."""
    qpos, bias = batch.bind("qpos"), batch.bind("qfrc_bias")
    batch.bind("qvel")[:] = 0.0
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
    inertia = _inertia(batch, model, layout)
    damping = batch.expand("dof_damping")[:, layout.action_dof] + ports.friction["viscous"]
    friction = batch.expand("dof_frictionloss")[:, layout.action_dof] + ports.friction["coulomb"]
    return Plant(inertia, damping, friction, sine, cosine, constant)


def _inertia(batch: Batch, model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """(n, A) diagonal of the joint-space inertia matrix at the reset pose."""
    matrix = batch.bind("M")  # outputs are filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    diagonal = model.M_rowadr + model.M_rownnz - 1
    return matrix[:, diagonal[layout.action_dof]].copy()


def _start(robot: Robot, layout: Layout, batch: Batch, run: Run, n: int) -> tuple[np.ndarray, np.ndarray]:
    keyframe = robot.file.reset.keyframe
    batch.reset(keyframe=robot.model.keyframe(keyframe).id if keyframe else -1)
    q = batch.bind("qpos")[:, layout.action_qpos].copy()
    v = np.zeros_like(q)
    if run.initial is None:
        return q, v
    known = np.tile(run.initial, (n, 1))
    for target, (columns, addresses), wanted in (
        (q, layout.position, layout.action_qpos),
        (v, layout.velocity, layout.action_dof),
    ):
        for column, address in zip(columns, addresses, strict=True):
            at = np.flatnonzero(wanted == address)
            value = known[:, column, None]
            target[:, at] = np.where(np.isnan(value), target[:, at], value)
    return q, v


def _commands(layout, model, batch: Batch, ports: Ports, run: Run, q: np.ndarray) -> np.ndarray:
    steps, count = run.actions.shape[-2:]
    actions = run.actions.reshape(int(np.prod(run.actions.shape[:-2])), steps, count)
    actions = np.tile(actions, (batch.nsim // len(actions), 1, 1))
    low, high = limited_range(layout, model, batch, ports)
    noise = None if run.noise is None else run.noise.reshape(batch.nsim, steps, count)
    return shaped_commands(actions, np.where(takes_positions(ports), q, 0.0), low, high, ports, noise)


def _observe(robot: Robot, layout: Layout, positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """(n, T+1, S) state vectors of joint positions and velocities (T+1, n, A)."""
    states = np.zeros((positions.shape[1], positions.shape[0], len(robot.channels)))
    for source, (columns, addresses), wanted in (
        (positions, layout.position, layout.action_qpos),
        (velocities, layout.velocity, layout.action_dof),
    ):
        for column, address in zip(columns, addresses, strict=True):
            at = np.flatnonzero(wanted == address)[0]
            states[:, :, column] = source[:, :, at].T
    return states


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

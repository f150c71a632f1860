"""Any MJCF robot on `mujoco.batch.Batch`: each simulation with its own model fields, on a thread pool."""

import copy
from functools import lru_cache

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.sim.commands import shaped_commands
from dynreg.sim.engines.quiet import quiet
from dynreg.sim.fields import modify, set_field
from dynreg.sim.layout import Layout, layout_of, observe, place
from dynreg.sim.ports import Ports, ServoLaw, nominal_ports, servo_law, takes_positions, varies
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run


@quiet()
def rollout(robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0) -> Rollout:
    """Simulate B configurations (B, P) through the E episodes of `run`.

    Simulations are independent of each other and of the number of threads, bit for bit. A simulation that
    diverges holds NaN from then on.
    """
    model, layout = compiled(robot)
    n, episodes = len(values), run.episodes
    batch = Batch(model, n * episodes, nthread=threads)
    ports = configure(robot, batch, model, values, run)
    inputs = episode_inputs(robot, n, run)
    base = _Base(batch, layout)
    base.apply(servo_law(ports, inputs[:, 0]), ports)
    batch.set_const()
    period, substeps = _clock(robot, batch, ports, run)
    _reset(robot, batch, model, layout, episodes, run)
    return _advance(robot, batch, layout, base, ports, inputs, run, substeps)


def configure(robot: Robot, batch: Batch, model: mujoco.MjModel, values: np.ndarray, run: Run) -> Ports:
    """Write parameters and settings into the batch's fields and the returned ports, (B E) simulations."""
    n, episodes = len(values), run.episodes
    ports = nominal_ports(robot, n).repeat(episodes)
    settings = run.settings
    if settings is None:
        settings = np.tile([s.nominal for s in robot.file.settings], (episodes, 1))
    columns = [(a, np.repeat(values[:, i], episodes)) for i, s in enumerate(robot.setters) for a in s]
    columns += [(a, np.tile(settings[:, i], n)) for i, s in enumerate(robot.setting_setters) for a in s]
    for assignment, column in columns:
        if assignment.root == "mj":
            set_field(batch, model, assignment, column)
        elif assignment.root == "modifier":
            modify(batch, model, assignment, column)
        else:
            ports.apply(assignment, column)
    return ports


class _Base:
    """The fields that a servo law is written into, with the model's own damping underneath."""

    def __init__(self, batch: Batch, layout: Layout):
        self._at = layout.action_actuator
        self._dof = layout.action_dof
        self._gain, self._bias = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
        self._range = batch.expand("actuator_forcerange")
        self._damping, self._friction = batch.expand("dof_damping"), batch.expand("dof_frictionloss")
        self._own_damping = self._damping[:, self._dof].copy()
        self._own_friction = self._friction[:, self._dof].copy()

    def apply(self, law: ServoLaw, ports: Ports) -> None:
        self._gain[:, self._at, 0] = law.gain
        self._bias[:, self._at, 1] = -law.stiffness
        self._bias[:, self._at, 2] = -law.rate
        self._range[:, self._at, 0] = -law.limit
        self._range[:, self._at, 1] = law.limit
        self._damping[:, self._dof] = self._own_damping + law.damping + ports.friction["viscous"]
        self._friction[:, self._dof] = self._own_friction + ports.friction["coulomb"]


@lru_cache(maxsize=8)
def compiled(robot: Robot) -> tuple[mujoco.MjModel, Layout]:
    """The model with affine actuators (so that any drive is a choice of parameters) and its layout."""
    layout = layout_of(robot)
    model = copy.copy(robot.model)
    at = layout.action_actuator
    model.actuator_gaintype[at] = mujoco.mjtGain.mjGAIN_FIXED
    model.actuator_biastype[at] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[at] = 0.0
    model.actuator_forcelimited[at] = 1
    model.actuator_ctrllimited[at] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    # link lengths differ between simulations: bounding volumes of the midphase would be the base model's
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    return model, layout


def episode_inputs(robot: Robot, n: int, run: Run) -> np.ndarray:
    """(B E, T, I) inputs, defaults where the run has none or NaN."""
    defaults = robot.input_defaults
    if run.inputs is None:
        return np.broadcast_to(defaults, (n * run.episodes, run.steps, len(defaults)))
    filled = np.where(np.isnan(run.inputs), defaults, run.inputs)
    return np.tile(filled, (n, 1, 1))


def _clock(robot: Robot, batch: Batch, ports: Ports, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Command period [s] and physics steps in it; the time step of each simulation divides its period."""
    period = 1.0 / ports.control["rate"] if run.period is None else np.full(batch.nsim, run.period)
    substeps = np.maximum(np.ceil(period / robot.file.robot.timestep - 1e-9), 1).astype(int)
    batch.expand("opt.timestep")[:] = (period / substeps).reshape(batch.expand("opt.timestep").shape)
    return period, substeps


def _reset(
    robot: Robot, batch: Batch, model: mujoco.MjModel, layout: Layout, episodes: int, run: Run
) -> None:
    """Keyframe pose, feet on the ground, settled under the pose's own commands, then the known states."""
    name = robot.file.reset.keyframe
    batch.reset(keyframe=model.keyframe(name).id if name else -1)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    same = 1 if robot.settings or robot.inputs else episodes  # episodes that settle alike
    first = np.arange(0, batch.nsim, same)
    pose = qpos[:, layout.action_qpos].copy()
    drives = np.array([d == "position" or d == "duty_servo" for d in nominal_ports(robot, 1).types])
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos + 2] -= _clearance(batch, model)
    if robot.file.reset.settle > 0:
        ctrl[:, layout.action_actuator] = np.where(drives, pose, 0.0)
        steps = np.ceil(robot.file.reset.settle / batch.expand("opt.timestep").reshape(-1)).astype(int)
        for count in np.unique(steps[first]):
            batch.step(ids=first[steps[first] == count], nstep=int(count))
        qpos[:], qvel[:] = qpos[np.repeat(first, same)], qvel[np.repeat(first, same)]
        batch.bind("qacc_warmstart")[:] = 0.0  # of the episode that settled: it would start unlike the others
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos : layout.base_qpos + 2] = 0.0
    if run.initial is not None:
        known = np.tile(run.initial, (batch.nsim // episodes, 1))
        place(layout, known, qpos, qvel)


def _clearance(batch: Batch, model: mujoco.MjModel) -> np.ndarray:
    """(n,) height [m] of the lowest sphere or capsule end that can touch the ground, at the reset pose."""
    centres = batch.bind("geom_xpos")  # outputs are filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    spheres = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & (model.geom_contype > 0))
    if not len(spheres):
        return np.zeros(batch.nsim)
    return (centres[:, spheres, 2] - model.geom_size[spheres, 0]).min(axis=1)


def _advance(robot, batch, layout, base, ports, inputs, run: Run, substeps: np.ndarray) -> Rollout:
    n, steps, episodes = batch.nsim, run.steps, run.episodes
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    commands = _commands(layout, batch, ports, run, qpos)
    groups = [np.flatnonzero(substeps == count) for count in np.unique(substeps)]
    trace_q = np.empty((steps + 1, n, qpos.shape[1]))
    trace_v = np.empty((steps + 1, n, qvel.shape[1]))
    trace_q[0], trace_v[0] = qpos, qvel
    changing = varies(ports)
    for t in range(steps):
        if changing and t > 0:
            base.apply(servo_law(ports, inputs[:, t]), ports)
        ctrl[:, layout.action_actuator] = commands[:, t]
        for group in groups:
            batch.step(ids=None if len(groups) == 1 else group, nstep=int(substeps[group[0]]))
        trace_q[t + 1], trace_v[t + 1] = qpos, qvel
    diverged = ~(np.abs(trace_v).max(axis=2) < 1e4)
    states = observe(layout, np.swapaxes(trace_q, 0, 1), np.swapaxes(trace_v, 0, 1), len(robot.channels))
    states[np.maximum.accumulate(diverged, axis=0).T] = np.nan
    fell = _fell(robot, layout, trace_q)
    shape = (n // episodes, episodes)
    return Rollout(states.reshape(*shape, steps + 1, -1), fell.reshape(shape), int(substeps.sum()) * steps)


def _commands(layout: Layout, batch: Batch, ports: Ports, run: Run, qpos: np.ndarray) -> np.ndarray:
    """(B E, T, A) what the actuators are told; position commands stay inside the joints' own ranges."""
    n = batch.nsim
    steps, count = run.actions.shape[-2:]
    actions = run.actions.reshape(int(np.prod(run.actions.shape[:-2])), steps, count)
    actions = np.tile(actions, (n // len(actions), 1, 1)) if len(actions) < n else actions
    low, high = limited_range(layout, batch.get_model(0), batch, ports)
    noise = None if run.noise is None else run.noise.reshape(n, steps, count)
    start = np.where(takes_positions(ports), qpos[:, layout.action_qpos], 0.0)
    return shaped_commands(actions, start, low, high, ports, noise)


def limited_range(
    layout: Layout, model: mujoco.MjModel, batch: Batch, ports: Ports
) -> tuple[np.ndarray, np.ndarray]:
    """(n, A) lowest and highest commands: the actions' limits, for position servos also the joints' own."""
    n = batch.nsim
    low, high = (np.tile(layout.action_range[:, i], (n, 1)) for i in (0, 1))
    joints = model.dof_jntid[layout.action_dof]
    limited = takes_positions(ports) & (model.jnt_limited[joints] > 0)
    if limited.any():
        ranges = batch.expanded("jnt_range")
        ranges = np.tile(model.jnt_range, (n, 1, 1)) if ranges is None else ranges
        low[:, limited] = np.maximum(low[:, limited], ranges[:, joints[limited], 0])
        high[:, limited] = np.minimum(high[:, limited], ranges[:, joints[limited], 1])
    return low, high


def _fell(robot: Robot, layout: Layout, trace_q: np.ndarray) -> np.ndarray:
    """(n,) first recorded step at which the base tilts or sinks too far; T+1 where it never does."""
    steps, n = trace_q.shape[:2]
    if robot.file.fall is None or layout.base_qpos < 0:
        return np.full(n, steps)
    at = layout.base_qpos
    x, y = trace_q[..., at + 4], trace_q[..., at + 5]
    upright = 1 - 2 * (x * x + y * y)
    down = (upright < np.cos(robot.file.fall.tilt)) | (trace_q[..., at + 2] < robot.file.fall.height)
    return np.where(down.any(axis=0), down.argmax(axis=0), steps)

"""Any MJCF robot on `mujoco.batch.Batch`: each simulation with its own model fields, on a thread pool."""

import copy
from functools import lru_cache

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.sim.commands import shaped_commands
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import Acting, Clock, acting, configure_terms, observed, true_states
from dynreg.sim.engines.mujoco_steps import Drives, EffectSteps, Steps, busy_simulations
from dynreg.sim.engines.quiet import quiet
from dynreg.sim.fields import modify, set_field
from dynreg.sim.layout import Layout, layout_of, observe, place
from dynreg.sim.ports import Ports, nominal_ports, servo_law, takes_positions, varies
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run


@quiet()
def rollout(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Rollout:
    """Simulate B configurations (B, P) through the E episodes of `run`, with the effects in `terms`.

    Simulations are independent of each other and of the number of threads, bit for bit. A simulation that
    diverges holds NaN from then on.
    """
    model, layout = compiled(robot)
    n, episodes = len(values), run.episodes
    batch = Batch(model, n * episodes, nthread=threads)
    ports = configure(robot, batch, model, values, run)
    active = acting(robot, terms, episodes, batch.nsim)
    configure_terms(robot, active, ports, batch.expand)
    inputs = episode_inputs(robot, n, run)
    drives = Drives(batch, layout)
    drives.apply(servo_law(ports, inputs[:, 0]), ports)
    batch.set_const()
    period, begin = clock_of(batch.nsim, ports, run)
    h = _time_steps(robot, batch, period)
    busy = busy_simulations(active, batch.nsim)
    inertia = _inertia(robot, batch, model, layout) if len(busy) else None
    _reset(robot, batch, model, layout, episodes, run, ports)
    clock = Clock(_commands(layout, batch, ports, run), period, h, begin)
    if len(busy):
        steps = EffectSteps(batch, layout, drives, clock, busy, active, ports, inertia)
    else:
        steps = Steps(batch, layout, drives, clock, busy)
    states, fell = _advance(robot, batch, layout, steps, drives, ports, inputs, active)
    shape = (n, episodes)
    taken = int(clock.substeps.sum()) * run.steps
    return Rollout(states.reshape(*shape, run.steps + 1, -1), fell.reshape(shape), taken)


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


def clock_of(n: int, ports: Ports, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Of n simulations (n,): the period between commands [s], and when each episode of the log began [s]."""
    period = 1.0 / ports.control["rate"] if run.period is None else np.full(n, run.period)
    begin = np.zeros(run.episodes) if run.begin is None else run.begin
    return period * ports.control["clock"], np.tile(begin, n // run.episodes)


def _time_steps(robot: Robot, batch: Batch, period: np.ndarray) -> np.ndarray:
    """(n,) physics time step [s]: that of each simulation divides its period between commands."""
    substeps = robot.substeps(period)
    batch.expand("opt.timestep")[:] = (period / substeps).reshape(batch.expand("opt.timestep").shape)
    return period / substeps


def _inertia(robot: Robot, batch: Batch, model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """(n, A) diagonal of the joint-space inertia matrix at the reset pose."""
    name = robot.file.reset.keyframe
    matrix = batch.bind("M")  # outputs are filled by calls made after they are bound
    batch.reset(keyframe=model.keyframe(name).id if name else -1, stage=mujoco.mjtStage.mjSTAGE_POS)
    diagonal = model.M_rowadr + model.M_rownnz - 1
    return matrix[:, diagonal[layout.action_dof]].copy()


def _reset(
    robot: Robot,
    batch: Batch,
    model: mujoco.MjModel,
    layout: Layout,
    episodes: int,
    run: Run,
    ports: Ports,
) -> None:
    """Keyframe pose, feet on the ground, settled under the pose's own commands, then the known states."""
    name = robot.file.reset.keyframe
    batch.reset(keyframe=model.keyframe(name).id if name else -1)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    same = 1 if robot.settings or robot.inputs else episodes  # episodes that settle alike
    first = np.arange(0, batch.nsim, same)
    pose = qpos[:, layout.action_qpos].copy()
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos + 2] -= _clearance(batch, model)
    if robot.file.reset.settle > 0:
        ctrl[:, layout.action_actuator] = np.where(takes_positions(ports), pose, 0.0)
        steps = np.ceil(robot.file.reset.settle / batch.expand("opt.timestep").reshape(-1)).astype(int)
        for count in np.unique(steps[first]):
            batch.step(ids=first[steps[first] == count], nstep=int(count))
        qpos[:], qvel[:] = qpos[np.repeat(first, same)], qvel[np.repeat(first, same)]
        batch.bind("qacc_warmstart")[:] = 0.0  # of the episode that settled: it would start unlike the others
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos : layout.base_qpos + 2] = 0.0
    if run.initial is not None:
        known = np.tile(run.initial, (batch.nsim // episodes, 1))
        place(layout, true_states(robot, known, ports), qpos, qvel)
    rail = _rail(model, layout)
    if rail >= 0:
        qpos[:, rail] += np.maximum(-_clearance(batch, model), 0.0)


def _rail(model: mujoco.MjModel, layout: Layout) -> int:
    """Position of a vertical slide that carries the robot and that no log knows; -1 where there is none.

    The robot is lifted along it until its feet are above the ground, whatever pose its joints start in.
    """
    known = {*layout.position[1], *layout.action_qpos}
    for joint in range(model.njnt):
        slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE and model.jnt_axis[joint, 2] > 0.99
        on_world = model.body_parentid[model.jnt_bodyid[joint]] == 0
        if slide and on_world and model.jnt_qposadr[joint] not in known:
            return int(model.jnt_qposadr[joint])
    return -1


def _clearance(batch: Batch, model: mujoco.MjModel) -> np.ndarray:
    """(n,) height [m] of the lowest sphere or capsule end that can touch the ground, at the reset pose."""
    centres = batch.bind("geom_xpos")  # outputs are filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    spheres = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & (model.geom_contype > 0))
    if not len(spheres):
        return np.zeros(batch.nsim)
    return (centres[:, spheres, 2] - model.geom_size[spheres, 0]).min(axis=1)


def _advance(
    robot: Robot,
    batch: Batch,
    layout: Layout,
    steps: Steps,
    drives: Drives,
    ports: Ports,
    inputs: np.ndarray,
    active: list[Acting],
) -> tuple[np.ndarray, np.ndarray]:
    """States (n, T+1, S) that the log holds and (n,) the step at which each simulation fell."""
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    count = steps.clock.commands.shape[1]
    trace_q = np.empty((count + 1, *qpos.shape))
    trace_v = np.empty((count + 1, *qvel.shape))
    trace_q[0], trace_v[0] = qpos, qvel
    changing = varies(ports)
    for t in range(count):
        if changing and t > 0:
            drives.apply(servo_law(ports, inputs[:, t]), ports)
        steps.hold(t)
        trace_q[t + 1], trace_v[t + 1] = qpos, qvel
    diverged = ~(np.abs(trace_v).max(axis=2) < 1e4)
    states = observe(layout, np.swapaxes(trace_q, 0, 1), np.swapaxes(trace_v, 0, 1), len(robot.channels))
    states = observed(robot, active, states, ports, steps.clock.period)
    states[np.maximum.accumulate(diverged, axis=0).T] = np.nan
    return states, _fell(robot, layout, trace_q)


def _commands(layout: Layout, batch: Batch, ports: Ports, run: Run) -> np.ndarray:
    """(B E, T, A) what the actuators are told; position commands stay inside the joints' own ranges."""
    n = batch.nsim
    steps, count = run.actions.shape[-2:]
    actions = run.actions.reshape(int(np.prod(run.actions.shape[:-2])), steps, count)
    actions = np.tile(actions, (n // len(actions), 1, 1)) if len(actions) < n else actions
    low, high = limited_range(layout, batch.get_model(0), batch, ports)
    noise = None if run.noise is None else run.noise.reshape(n, steps, count)
    start = np.where(takes_positions(ports), batch.bind("qpos")[:, layout.action_qpos], 0.0)
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

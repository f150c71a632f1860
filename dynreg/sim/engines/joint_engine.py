"""Independent joints, compiled: servo benches, legs in the air, an arm joint by joint.

Each driven joint moves alone, the others held where they start: inertia and gravity load come from the same
MuJoCo model and the same `sets` as in the mujoco engine, so one robot folder serves both.
"""

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms
from dynreg.sim.engines.acting import (
    acting,
    clock_of,
    configure_terms,
    first_known,
    observed,
    true_states,
    with_drives,
)
from dynreg.sim.engines.diverged import diverged
from dynreg.sim.engines.joint_blocks import Joints, integrate
from dynreg.sim.engines.joint_stops import stop_rows
from dynreg.sim.engines.mujoco_model import (
    compiled,
    configure,
    episode_inputs,
    joint_inertia,
    told,
    told_before,
)
from dynreg.sim.layout import Layout, observe, place
from dynreg.sim.ports import TYPES, Ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated


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
    active = with_drives(active, robot, ports)
    batch.set_const()
    inputs = episode_inputs(robot, run)
    q, v = _start(robot, layout, batch, run, ports)
    plant = _plant(batch, model, layout, ports)
    period, begin = clock_of(ports, run)
    # each simulator divides its own period, whatever others are in the batch
    substeps = robot.substeps(period)
    stops = stop_rows(batch, model, layout, period / substeps)
    commands = told(layout, ports, run, q)
    drives = np.array(robot.drives_of(run.joints), dtype=int)
    rows = _of_drives(ports) | plant | stops | {"AT": q, "V": v}
    rows = {name: values[:, drives] for name, values in rows.items()}
    rows |= {"H": (period / substeps)[:, None], "PERIOD": period[:, None], "BEGIN": begin[:, None]}
    before = told_before(layout, run)
    rows["FIRST"] = first_known(before, len(values))[:, None]
    heard = np.stack([ports.supply_input, ports.enable_input])[:, drives]
    draws = None if run.draws is None else run.draws[..., drives]
    before = None if before is None else before[..., drives]
    joints = Joints(rows, substeps, commands[..., drives], draws, before, inputs, heard)
    positions, velocities = integrate(joints, active, drives, threads)
    # whole poses, of which the joints that are left out are not known
    qpos, qvel = (np.full((batch.nsim, run.steps + 1, size), np.nan) for size in (model.nq, model.nv))
    qpos[..., layout.action_qpos[drives]], qvel[..., layout.action_dof[drives]] = positions, velocities
    states = observe(layout, qpos, qvel, len(robot.channels))
    states = observed(robot, active, states, ports, period)
    states[diverged(velocities)] = np.nan
    return Simulated(states, np.full(len(values), run.steps + 1), substeps * run.steps)


def _of_drives(ports: Ports) -> dict[str, np.ndarray]:
    """{row of `joint_kernel`: (n, A)} of drives and encoders."""
    shape = ports.sensor["scale"].shape
    types = {
        f"IS_{kind.upper()}": np.broadcast_to([kind == own for own in ports.types], shape) for kind in TYPES
    }
    # of wheels, and of what acts as an effect
    others = ("lag", "profile_speed", "profile_acceleration", "integral_gain")
    keys = {key.upper(): values for key, values in (ports.drive | ports.sensor).items() if key not in others}
    return types | keys


def _plant(batch: Batch, model: mujoco.MjModel, layout: Layout, ports: Ports) -> dict[str, np.ndarray]:
    """{row of `joint_kernel`: (n, A)}: I qdd = torque - load(q) - friction, with the load a sin(q + b) + c.

    Inertia [kg m^2 or kg], viscous [N m s/rad], coulomb [N m]; the load [N m] by MuJoCo's own bias force at three
    positions of a joint, exact for one hinge.
    """
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
    return {
        "INERTIA": inertia,
        "VISCOUS": damping,
        "COULOMB": friction,
        "AMPLITUDE": np.hypot(sine, cosine),
        "PHASE": np.arctan2(cosine, sine),
        "CONSTANT": constant,
    }


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

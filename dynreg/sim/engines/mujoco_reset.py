"""Where an episode starts: the keyframe's pose, feet on the ground, settled, then the known states."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.sim.engines.acting import true_states
from dynreg.sim.layout import Layout, place
from dynreg.sim.ports import Ports, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run


def reset(
    robot: Robot,
    batch: Batch,
    model: mujoco.MjModel,
    layout: Layout,
    run: Run,
    ports: Ports,
    told: list[np.ndarray],
) -> None:
    """Keyframe pose, feet on the ground, settled under the pose's own commands, then the known states.

    told : (n, ...) numbers that the simulations were made of. Those made of the same settle alike, and one for all.
    """
    batch.reset(keyframe=robot.keyframe)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    pose = qpos[:, layout.action_qpos].copy()
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos + 2] -= _clearance(batch, model)
    if robot.file.reset.settle > 0:
        ctrl[:, layout.action_actuator] = np.where(takes_positions(ports), pose, 0.0)
        steps = np.ceil(robot.file.reset.settle / batch.expand("opt.timestep").reshape(-1)).astype(int)
        first, alike = _alike(told)
        for count in np.unique(steps[first]):
            batch.step(ids=np.sort(first[steps[first] == count]), nstep=int(count))
        qpos[:], qvel[:] = qpos[first[alike]], qvel[first[alike]]
        batch.bind("qacc_warmstart")[:] = 0.0  # of the episode that settled: it would start unlike the others
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos : layout.base_qpos + 2] = 0.0
    if run.initial is not None:
        place(layout, true_states(robot, run.initial, ports), qpos, qvel)
    rail = _rail(model, layout)
    if rail >= 0:
        qpos[:, rail] += np.maximum(-_clearance(batch, model), 0.0)


def _alike(told: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The first simulation of each kind, and the number (n,) of every simulation's kind, from tables (n, ...)."""
    table = np.ascontiguousarray(np.concatenate([t.reshape(len(t), -1) for t in told], axis=1), dtype=float)
    rows = table.view(f"V{table.itemsize * table.shape[1]}")[:, 0]  # bytes: those without an effect are NaN
    _, first, alike = np.unique(rows, return_index=True, return_inverse=True)
    return first, alike


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


def foot_spheres(model: mujoco.MjModel) -> np.ndarray:
    """Numbers of the spheres that can touch the ground."""
    return np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & (model.geom_contype > 0))


def _clearance(batch: Batch, model: mujoco.MjModel) -> np.ndarray:
    """(n,) height [m] of the lowest sphere or capsule end that can touch the ground, at the reset pose."""
    centres = batch.bind("geom_xpos")  # outputs are filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    spheres = foot_spheres(model)
    if not len(spheres):
        return np.zeros(batch.nsim)
    return (centres[:, spheres, 2] - model.geom_size[spheres, 0]).min(axis=1)

"""Where an episode starts: the keyframe's pose, feet on the ground, settled, then the known states."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.sim.engines.acting import true_states
from dynreg.sim.fields import own_field
from dynreg.sim.layout import Layout, filters, place, place_base, start_place
from dynreg.sim.ports import Ports, takes_positions
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

LEVEL = 0.99  # of an axis, how far up it points


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
    What the drives' own filters hold is the pose, too, until a command comes.
    """
    batch.reset(keyframe=robot.keyframe)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    pose = np.where(takes_positions(ports), qpos[:, layout.action_qpos], 0.0)
    drives, places = filters(model, layout)
    act = batch.bind("act")
    act[:, places] = pose[:, drives]
    if layout.base_qpos >= 0:
        qpos[:, layout.base_qpos + 2] -= _clearance(batch, model, int(model.dof_bodyid[layout.base_dof]))
    if robot.file.reset.settle > 0:
        ctrl[:, layout.action_actuator] = pose
        steps = np.ceil(robot.file.reset.settle / batch.expand("opt.timestep").reshape(-1)).astype(int)
        first, alike = _alike(told)
        for count in np.unique(steps[first]):
            batch.step(ids=np.sort(first[steps[first] == count]), nstep=int(count))
        qpos[:], qvel[:], act[:] = qpos[first[alike]], qvel[first[alike]], act[first[alike]]
        batch.bind("qacc_warmstart")[:] = 0.0  # of the episode that settled: it would start unlike the others
    if layout.base_qpos >= 0:  # what settled has moved a little
        qpos[:, layout.base_qpos : layout.base_qpos + 2] = start_place(robot, layout)[:2]
    if run.initial is not None:
        states = true_states(robot, run.initial, ports)
        place(layout, states, qpos, qvel)
        if robot.file.reset.base == "measured" and layout.base_qpos >= 0:
            lower = place_base(layout, states, qpos, qvel)
            low = _clearance(batch, model, int(model.dof_bodyid[layout.base_dof]))
            qpos[lower, layout.base_qpos + 2] -= low[lower]
    rail = _rail(model, layout)
    if rail >= 0:
        carriage = int(model.jnt_bodyid[np.searchsorted(model.jnt_qposadr, rail)])
        ground = _ground(model, touching(model, carriage))
        qpos[:, rail] += np.maximum(ground - _clearance(batch, model, carriage), 0.0)


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
    known, data = {*layout.position[1], *layout.action_qpos}, mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    for joint in range(model.njnt):
        slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE and data.xaxis[joint, 2] > LEVEL
        on_world = model.body_parentid[model.jnt_bodyid[joint]] == 0
        if slide and on_world and model.jnt_qposadr[joint] not in known:
            return int(model.jnt_qposadr[joint])
    return -1


def _ground(model: mujoco.MjModel, own: np.ndarray) -> float:
    """Height [m] of the highest level plane that geoms `own` can touch; -inf where they can touch nothing of the world.

    0 where it has other shapes alone: which of those is a ground, nothing tells.
    """
    scene, data = scenery(model, own), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    up = data.geom_xmat[scene, 8]
    planes = scene[(model.geom_type[scene] == mujoco.mjtGeom.mjGEOM_PLANE) & (up > LEVEL)]
    heights = data.geom_xpos[planes, 2] if len(planes) else np.zeros(min(len(scene), 1))
    return float(max(heights, default=-np.inf))


def foot_spheres(model: mujoco.MjModel) -> np.ndarray:
    """Numbers of the spheres that can touch the ground."""
    return np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & _collides(model))


def named_geoms(model: mujoco.MjModel, geoms: np.ndarray) -> list[str]:
    """A name for each of these geoms (their numbers): its own, else that of its body, where no other has it."""
    own = [model.geom(int(g)).name for g in geoms]
    bodies = [model.body(int(model.geom_bodyid[g])).name for g in geoms]
    taken = [name or body for name, body in zip(own, bodies, strict=True)]
    told = zip(own, bodies, geoms, strict=True)
    return [name or (body if body and taken.count(body) == 1 else f"geom {g}") for name, body, g in told]


def _clearance(batch: Batch, model: mujoco.MjModel, root: int) -> np.ndarray:
    """(n,) height [m] of the lowest point, at the reset pose, of what can touch the ground and moves with body `root`.

    Of a mesh the lowest corner of its box.
    """
    centres, turned = (
        batch.bind("geom_xpos"),
        batch.bind("geom_xmat"),
    )  # filled by calls made after they are bound
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
    sizes = own_field(batch, model, "geom_size")
    heights = [lowest(model, int(g), sizes[:, g], centres[:, g], turned[:, g]) for g in touching(model, root)]
    return np.min(heights, axis=0) if heights else np.zeros(batch.nsim)


def touching(model: mujoco.MjModel, root: int) -> np.ndarray:
    """Numbers of the geoms on body `root` and on what it carries that can touch others."""
    carried = model.body_rootid[model.geom_bodyid] == model.body_rootid[root]
    return np.flatnonzero(carried & _collides(model))


def scenery(model: mujoco.MjModel, own: np.ndarray) -> np.ndarray:
    """Numbers of the geoms of the world that those of the robot (their numbers) can touch."""
    still = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    meets = [
        g
        for g in still
        if (
            (model.geom_contype[g] & model.geom_conaffinity[own])
            | (model.geom_conaffinity[g] & model.geom_contype[own])
        ).any()
    ]
    return np.array(meets, dtype=int)


def _collides(model: mujoco.MjModel) -> np.ndarray:
    """(G,) which geoms can touch others; contacts take the `contype` of one and the `conaffinity` of the other."""
    return (model.geom_contype > 0) | (model.geom_conaffinity > 0)


def lowest(
    model: mujoco.MjModel, geom: int, size: np.ndarray, centre: np.ndarray, turned: np.ndarray
) -> np.ndarray:
    """(n,) height of a geom's lowest point, from its size (n or 1, 3), its centre (n, 3) and its rotation (n, 9)."""
    kind = model.geom_type[geom]
    down = turned.reshape(-1, 3, 3)[:, 2]  # how far up each axis of the geom points
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return centre[:, 2] - size[:, 0]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return centre[:, 2] - size[:, 0] - np.abs(down[:, 2]) * size[:, 1]
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return (
            centre[:, 2]
            - np.abs(down[:, 2]) * size[:, 1]
            - np.sqrt(np.maximum(1 - down[:, 2] ** 2, 0.0)) * size[:, 0]
        )
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return centre[:, 2] - np.sqrt(((down * size) ** 2).sum(axis=1))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return centre[:, 2] - (np.abs(down) * size).sum(axis=1)
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return centre[:, 2] + down @ middle - np.abs(down) @ half

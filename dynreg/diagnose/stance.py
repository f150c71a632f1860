"""Which feet of a walking robot could touch the ground, by the geometry of its measured pose alone."""

import numpy as np

from dynreg.diagnose.signals import joints_of_actions
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

NEAR = 0.01  # m above the lowest point of the robot within which a foot counts as down


def stance(robot: Robot, windows: Windows) -> dict[str, np.ndarray] | None:
    """{joint: (W, T)} 1 where a foot below the joint is down at the command, 0 where none is, NaN where not known.

    Feet are the last bodies of each limb. The lowest point of the robot is taken to stand on level ground, so a
    flight phase is not seen. None where the robot has no floating base, or its roll, pitch or a joint is not measured.
    """
    if robot.planar:
        return None
    from dynreg.sim.layout import layout_of

    layout = layout_of(robot)
    columns, which = layout.base
    tilt = {int(w): int(c) for c, w in zip(columns, which, strict=True)}
    feet = _feet(robot)
    if not feet or 3 not in tilt or 4 not in tilt:
        return None
    rows = windows.measured[:, :-1].reshape(-1, windows.measured.shape[-1])
    needed = [tilt[3], tilt[4], *layout.position[0]]
    known = np.isfinite(rows[:, needed]).all(axis=1)
    if not known.any():
        return None
    down = _down(robot, layout, rows, np.flatnonzero(known), (tilt[3], tilt[4]), list(feet))
    shape = windows.measured.shape[:1] + (windows.run.steps,)
    out = {}
    for joint in dict.fromkeys(joints_of_actions(robot)):
        below = [i for i, chain in enumerate(feet.values()) if joint in chain]
        if below:
            out[joint] = np.where(known, down[:, below].any(axis=1), np.nan).reshape(shape)
    return out or None


def _feet(robot: Robot) -> dict[int, set[str]]:
    """{last body of a limb of the floating base: the joints between it and the base}."""
    import mujoco

    model = robot.model
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not len(free):
        return {}
    base, parents = int(model.jnt_bodyid[free[0]]), set(model.body_parentid.tolist())
    out = {}
    for body in range(1, model.nbody):
        chain, at = set(), body
        while at not in (0, base):
            first = model.body_jntadr[at]
            chain |= {model.joint(first + i).name for i in range(model.body_jntnum[at])}
            at = int(model.body_parentid[at])
        if at == base and body not in parents and chain and len(_touching(model, body)):
            out[body] = chain
    return out


def _touching(model, body: int) -> np.ndarray:
    """Geoms of a body that can touch something."""
    own = np.flatnonzero(model.geom_bodyid == body)
    return own[(model.geom_contype[own] > 0) | (model.geom_conaffinity[own] > 0)]


def _down(
    robot: Robot, layout, rows: np.ndarray, chosen: np.ndarray, tilt: tuple[int, int], feet: list[int]
) -> np.ndarray:
    """(N, feet) whether each is within NEAR of the robot's lowest point, in the `chosen` rows; False in others."""
    import mujoco

    model = robot.model
    data = mujoco.MjData(model)
    own = np.concatenate([_touching(model, b) for b in range(1, model.nbody)])
    owner = model.geom_bodyid[own]
    out = np.zeros((len(rows), len(feet)), dtype=bool)
    for n in chosen:
        data.qpos[layout.position[1]] = rows[n, layout.position[0]]
        data.qpos[layout.base_qpos + 3 : layout.base_qpos + 7] = _quaternion(*rows[n, list(tilt)])
        mujoco.mj_kinematics(model, data)
        low = _lowest(model, data, own)
        out[n] = [low[owner == foot].min() <= low.min() + NEAR for foot in feet]
    return out


def _lowest(model, data, geoms: np.ndarray) -> np.ndarray:
    """[m] height of the lowest point of each geom: exact for spheres, capsules and boxes, a bound for others."""
    import mujoco

    down = data.geom_xmat[geoms].reshape(-1, 3, 3)[:, 2]  # the world's z in the geom's axes
    centre = data.geom_xpos[geoms, 2] + np.sum(down * model.geom_aabb[geoms, :3], axis=1)
    half, size = model.geom_aabb[geoms, 3:], model.geom_size[geoms]
    reach = np.sum(np.abs(down) * half, axis=1)
    kind = model.geom_type[geoms]
    reach = np.where(kind == mujoco.mjtGeom.mjGEOM_SPHERE, size[:, 0], reach)
    capsule = size[:, 0] + np.abs(down[:, 2]) * size[:, 1]
    return centre - np.where(kind == mujoco.mjtGeom.mjGEOM_CAPSULE, capsule, reach)


def _quaternion(roll: float, pitch: float) -> np.ndarray:
    """(4,) of Ry(pitch) Rx(roll): a base's roll and pitch as its channels give them, yaw left at 0."""
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    return np.array([cr * cp, sr * cp, cr * sp, -sr * sp])

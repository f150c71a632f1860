"""Effects of bodies: masses, inertia and gravity are not where the model has them."""

import mujoco
import numpy as np

from dynreg.sim.effects.effect import DEGREE, Effect, EffectParameter, Site, Values
from dynreg.sim.robot import Robot


class _OfMasses(Effect):
    """Needs an engine that has masses."""

    acts_on = "body"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        return "no engine of the robot has masses" if robot.planar else None


class Payload(_OfMasses):
    """The carrying body (the heaviest that the joints move; a floating base's own) is heavier."""

    id, title = "payload", "the robot carries more mass than the model"
    parameters = (EffectParameter("share", "1", "share of the body's mass", 0.05, 0.15, 0.40, 3.0),)
    near = ("inertia", "coulomb_friction", "drive_gain")
    separate_by = "a slow triangle against a chirp, or a known mass added"

    def configure(self, site: Site, p: Values) -> None:
        # a share of the model's own mass: a known mass that a setting adds stays what it is
        body, model = carrier(site.robot), site.robot.model
        site.expand("body_mass")[site.rows, body] += p["share"][:, 0] * model.body_mass[body]
        site.expand("body_inertia")[site.rows, body] += p["share"] * model.body_inertia[body]


class ComOffset(_OfMasses):
    """The carrying body's centre of mass lies beside where the model has it."""

    id, title = "com_offset", "the centre of mass lies beside the model's"
    parameters = (
        EffectParameter(
            "shift",
            "m",
            "across the link (forward on a base)",
            0.0175,
            0.0524,
            0.14,
            0.8,
            per="length",
            signed=True,
        ),
    )
    group = "gravity phase"
    near = ("payload",)
    separate_by = "turn the base by 180 degrees, and remove the load"

    def about(self, robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
        hinge = tilt_hinge(robot)
        alone = robot.model.njnt == 1  # else what hangs on the body keeps its weight where it is
        return (robot.model.joint(hinge).name,) if alone and hinge is not None else None

    def configure(self, site: Site, p: Values) -> None:
        body = carrier(site.robot)
        across = direction_across(site.robot)
        site.expand("body_ipos")[site.rows, body] += p["shift"] * across


class Inertia(Effect):
    """Inertia that carries no weight: the reflected inertia of a rotor and its gear."""

    id, acts_on, title = "inertia", "body", "the joint has more inertia (a reflected rotor, for one)"
    parameters = (
        EffectParameter("armature", "kg*m^2", "added inertia", 0.10, 0.30, 0.70, 4.0, per="inertia"),
    )
    near = ("payload", "clock_error")
    separate_by = "a slow triangle against a chirp"

    def configure(self, site: Site, p: Values) -> None:
        dofs = driven_dofs(site.robot)[site.joints]
        armature = site.expand("dof_armature")
        where = np.ix_(np.arange(len(armature))[site.rows], dofs)
        armature[where] = armature[where] + p["armature"]


class GravityTilt(_OfMasses):
    """The base of the robot is not level: gravity points `angle` off, about the axis of its main joint."""

    id, title = "gravity_tilt", "the base is not level"
    parameters = (
        EffectParameter("angle", "rad", "tilt", 1 * DEGREE, 3 * DEGREE, 8 * DEGREE, 0.5, signed=True),
    )
    group = "gravity phase"
    near = ("force_offset", "imu_misalignment")
    separate_by = "turn the base by 180 degrees, and remove the load"

    def why_not(self, robot: Robot) -> str | None:
        return super().why_not(robot) or (
            None if np.linalg.norm(robot.model.opt.gravity) > 0 else "the model has no gravity"
        )

    def about(self, robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
        hinge = tilt_hinge(robot)
        return (robot.model.joint(hinge).name,) if hinge is not None and _turns_all(robot, hinge) else None

    def configure(self, site: Site, p: Values) -> None:
        gravity = site.expand("opt.gravity")
        axis = tilt_axis(site.robot)
        g, angle = gravity[site.rows], p["angle"]
        # Rodrigues: rotate the gravity of each row about the axis
        gravity[site.rows] = (
            g * np.cos(angle)
            + np.cross(axis, g) * np.sin(angle)
            + axis * (g @ axis)[:, None] * (1.0 - np.cos(angle))
        )


def carrier(robot: Robot) -> int:
    """The body that a payload sits on: a floating base's own, else the heaviest that driven joints move.

    Without drives it is the heaviest that any joint moves.
    """
    model = robot.model
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if len(free):
        return int(model.jnt_bodyid[free[0]])
    moving = model.body_weldid > 0
    if robot.actions:
        moving = np.zeros(model.nbody, dtype=bool)
        moving[model.dof_bodyid[driven_dofs(robot)]] = True
        for body in range(1, model.nbody):  # parents come first
            moving[body] |= moving[model.body_parentid[body]]
    return int(np.argmax(np.where(moving, model.body_mass, -1.0)))


def driven_dofs(robot: Robot) -> np.ndarray:
    """(A,) degree of freedom of each action's joint."""
    model = robot.model
    return np.array([model.joint(joint).dofadr[0] for joint in robot.joints], dtype=int)


def tilt_axis(robot: Robot) -> np.ndarray:
    """(3,) unit axis in the world about which a tilt acts: the first hinge's, a floating base's y."""
    hinge = tilt_hinge(robot)
    return np.array([0.0, 1.0, 0.0]) if hinge is None else at_reset(robot).xaxis[hinge].copy()


def tilt_hinge(robot: Robot) -> int | None:
    """The first hinge that a tilt can act about; None on a floating base, and without hinges."""
    kinds = robot.model.jnt_type
    hinges = np.flatnonzero(kinds == mujoco.mjtJoint.mjJNT_HINGE)
    if (kinds == mujoco.mjtJoint.mjJNT_FREE).any() or not len(hinges):
        return None
    # tilting about gravity itself does nothing
    level = np.abs(at_reset(robot).xaxis[hinges, 2]) < 0.9
    return int((hinges[level] if level.any() else hinges)[0])


def _turns_all(robot: Robot, hinge: int) -> bool:
    """Whether the hinge turns every driven joint after it, and no other hinge turns it: it turns as the base does."""
    model = robot.model
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    driven = model.dof_jntid[driven_dofs(robot)] if robot.actions else hinges
    below = [_hangs_on(model, int(joint), hinge) for joint in driven]
    above = [_hangs_on(model, hinge, int(joint)) for joint in hinges if joint != hinge]
    return all(below) and not any(above)


def _hangs_on(model, joint: int, other: int) -> bool:
    """Whether what a joint moves hangs on what another moves (or is the same body's, after it)."""
    body, target = int(model.jnt_bodyid[joint]), int(model.jnt_bodyid[other])
    if body == target:
        return joint >= other
    while body > 0:
        body = int(model.body_parentid[body])
        if body == target:
            return True
    return False


def direction_across(robot: Robot) -> np.ndarray:
    """(3,) in the carrier's frame: across the link in the plane of its motion, forward (x) on a floating base."""
    model, body = robot.model, carrier(robot)
    if (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any():
        return np.array([1.0, 0.0, 0.0])
    data = at_reset(robot)
    joint = _moving_joint(robot)
    across = np.cross(data.xaxis[joint], data.xipos[body] - data.xanchor[joint])
    length = np.linalg.norm(across)
    across = across / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return data.xmat[body].reshape(3, 3).T @ across


def lever(robot: Robot) -> float:
    """[m] from the joint that moves the carrier to its centre of mass; 0.1 where they coincide."""
    if (robot.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any():
        return float(robot.model.stat.extent) / 4
    data = at_reset(robot)
    length = float(np.linalg.norm(data.xipos[carrier(robot)] - data.xanchor[_moving_joint(robot)]))
    return length if length > 1e-3 else 0.1


def at_reset(robot: Robot):
    """mujoco.MjData of the model at its reset pose, positions evaluated."""
    model = robot.model
    data = mujoco.MjData(model)
    if robot.keyframe >= 0:
        mujoco.mj_resetDataKeyframe(model, data, robot.keyframe)
    mujoco.mj_forward(model, data)
    return data


def _moving_joint(robot: Robot) -> int:
    model, body = robot.model, carrier(robot)
    while body and not model.body_jntnum[body]:
        body = int(model.body_parentid[body])
    return int(model.body_jntadr[body])

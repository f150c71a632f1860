"""Effects of bodies: masses, inertia and gravity are not where the model has them."""

from collections.abc import Mapping

import mujoco
import numpy as np

from dynreg.errors import quoted
from dynreg.sim.effects.effect import DEGREE, Effect, EffectParameter, Site, Values
from dynreg.sim.masses import grow, weight_at
from dynreg.sim.robot import Robot


class _OfMasses(Effect):
    """Needs an engine that has masses."""

    acts_on = "body"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        return "no engine of the robot has masses" if robot.planar else None


class _OnBody(_OfMasses):
    """Of one body: without a name the carrying one (the heaviest that the joints move; a floating base's own)."""

    scope = "body"

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        return ((), *((name,) for name in distal_bodies(robot)))

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        names = moving_bodies(robot)
        if len(at) > 1:
            return f"{len(at)} places", "one body"
        return (f"no body {at[0]!r} moves", f"one of {quoted(names)}") if at and at[0] not in names else None


class Payload(_OnBody):
    """A mass that the model does not have: on a body, about its centre, or at a tool frame with the site's shape."""

    id, title = "payload", "the robot carries more mass than the model"
    parameters = (EffectParameter("mass", "kg", "added mass", 0.05, 0.15, 0.40, 3.0, per="mass"),)
    near = ("inertia", "coulomb_friction", "drive_gain")
    separate_by = "a slow triangle against a chirp, or a known mass added"

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        return (*super().places(robot), *((name,) for name in robot.tools))

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        if len(at) == 1 and at[0] in robot.tools:
            return None
        wrong = super().misplaced(robot, at)
        return wrong and (wrong[0], f"{wrong[1]}, or of the tools {quoted(robot.tools)}")

    def told(self, robot: Robot, at: tuple[str, ...], values: Mapping[str, float]) -> Mapping[str, float]:
        # simulators of dynreg before 0.2 have it as a share of the carrying body's mass
        if {*values} != {"share"} or at:
            return values
        return {"mass": values["share"] * float(robot.model.body_mass[carrier(robot)])}

    def sets(self, robot: Robot, at: tuple[str, ...]) -> Mapping[str, str]:
        return {"mass": f"modifier.added_mass[{at[0]}] +="} if at and at[0] in robot.tools else {}

    def configure(self, site: Site, p: Values) -> None:
        model = site.robot.model
        if site.at and site.at[0] in site.robot.tools:
            weight_at(model, site.at[0]).add(site.expand, site.rows, p["mass"][:, 0])
        else:
            grow(site.expand, model, site.rows, body_at(site.robot, site.at), p["mass"])


class ComOffset(_OnBody):
    """A body's centre of mass lies beside where the model has it."""

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
        body = body_at(site.robot, site.at)
        site.expand("body_ipos")[site.rows, body] += p["shift"] * direction_across(site.robot, body)


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
    if robot.floating:
        return int(model.jnt_bodyid[robot.base])
    moving = model.body_weldid > 0
    if robot.actions:
        moving = np.zeros(model.nbody, dtype=bool)
        moving[model.dof_bodyid[driven_dofs(robot)]] = True
        for body in range(1, model.nbody):  # parents come first
            moving[body] |= moving[model.body_parentid[body]]
    return int(np.argmax(np.where(moving, model.body_mass, -1.0)))


def body_at(robot: Robot, at: tuple[str, ...]) -> int:
    """The body that a place names; the carrying one where it names none."""
    return int(robot.model.body(at[0]).id) if at else carrier(robot)


def moving_bodies(robot: Robot) -> list[str]:
    """Names of the bodies that joints move."""
    model = robot.model
    return [model.body(b).name for b in range(1, model.nbody) if model.body_weldid[b] and model.body(b).name]


def distal_bodies(robot: Robot) -> list[str]:
    """Names of the bodies, besides the carrying one, where a robot on a fixed base may carry something.

    They are the outer half of each chain of bodies after which nothing branches: nearer to the base a mass does little
    that friction and gains could not do. Of bodies welded together it is the first, as they move as one. A robot on a
    floating base carries on its base, or at a tool frame.
    """
    model = robot.model
    if robot.planar or robot.floating:
        return []
    roots = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
    after: dict[int, list[int]] = {b: [] for b in (0, *roots)}
    for body in roots:
        after[int(model.body_weldid[model.body_parentid[body]])].append(body)
    found = []
    for leaf in (b for b in roots if not after[b]):
        chain = [leaf]
        while (parent := int(model.body_weldid[model.body_parentid[chain[-1]]])) and len(after[parent]) == 1:
            chain.append(parent)
        found += chain[: max(1, len(chain) // 2)]
    carrying = int(model.body_weldid[carrier(robot)])
    return [name for b in sorted(found) if b != carrying and (name := model.body(b).name)]


def neighbours(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Pairs of driven hinges of which the second hangs on the first with no other driven joint between them."""
    model, out = robot.model, []
    hinges = [j for j in robot.driven if model.joint(j).type[0] == mujoco.mjtJoint.mjJNT_HINGE]
    numbers = {j: int(model.joint(j).id) for j in robot.driven}
    for second in hinges:
        below = [j for j in robot.driven if j != second and _hangs_on(model, numbers[second], numbers[j])]
        # the last of them hangs on all the others
        last = [
            j
            for j in below
            if sum(_hangs_on(model, numbers[j], numbers[k]) for k in below if k != j) == len(below) - 1
        ]
        out += [(first, second) for first in last if first in hinges]
    return tuple(out)


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
    hinges = np.flatnonzero(robot.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    if robot.floating or not len(hinges):
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


def direction_across(robot: Robot, body: int) -> np.ndarray:
    """(3,) in a body's frame: across the link in the plane of its motion, forward (x) on a floating base."""
    if robot.floating:
        return np.array([1.0, 0.0, 0.0])
    data = at_reset(robot)
    joint = _moving_joint(robot, body)
    across = np.cross(data.xaxis[joint], data.xipos[body] - data.xanchor[joint])
    length = np.linalg.norm(across)
    across = across / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return data.xmat[body].reshape(3, 3).T @ across


def lever(robot: Robot, body: int) -> float:
    """[m] from the joint that moves a body to its centre of mass; 0.1 where they coincide."""
    if robot.floating:
        return float(robot.model.stat.extent) / 4
    data = at_reset(robot)
    length = float(np.linalg.norm(data.xipos[body] - data.xanchor[_moving_joint(robot, body)]))
    return length if length > 1e-3 else 0.1


def at_reset(robot: Robot):
    """mujoco.MjData of the model at its reset pose, positions evaluated."""
    model = robot.model
    data = mujoco.MjData(model)
    if robot.keyframe >= 0:
        mujoco.mj_resetDataKeyframe(model, data, robot.keyframe)
    mujoco.mj_forward(model, data)
    return data


def _moving_joint(robot: Robot, body: int) -> int:
    model = robot.model
    while body and not model.body_jntnum[body]:
        body = int(model.body_parentid[body])
    return int(model.body_jntadr[body])

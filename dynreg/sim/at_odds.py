"""What a MuJoCo model does that robot.toml does not say, or that an engine leaves out: each finding is a warning."""

from collections.abc import Iterator

import mujoco
import numpy as np

from dynreg.sim.finding import Said
from dynreg.sim.held import JOINT, SINGLE, switched_on
from dynreg.sim.layout import FILTERS, layout_of
from dynreg.sim.robot import Robot

NEAR = 1e-6  # m
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
FLAGS = {  # of an MJCF, which switch off what the joint engine has
    "actuation": mujoco.mjtDisableBit.mjDSBL_ACTUATION,
    "constraint": mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    "damper": mujoco.mjtDisableBit.mjDSBL_DAMPER,
    "frictionloss": mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
    "limit": mujoco.mjtDisableBit.mjDSBL_LIMIT,
}


def at_odds(robot: Robot) -> Iterator[Said]:
    """Warnings about the model of a robot whose base moves in MuJoCo; every name of robot.toml must resolve."""
    yield from _ground_elsewhere(robot)
    yield from _actuators(robot)
    yield from _left_out(robot)
    yield from _bound_unseen(robot)


def _ground_elsewhere(robot: Robot) -> Iterator[Said]:
    """A plane that is not at height 0, where episodes set a free robot's feet."""
    model = robot.model
    planes = np.flatnonzero((model.geom_type == PLANE) & (model.geom_bodyid == 0))
    heights = [
        float(model.geom_pos[g, 2]) for g in planes if model.geom_contype[g] or model.geom_conaffinity[g]
    ]
    if robot.floating and heights and not any(abs(height) < NEAR for height in heights):
        yield (
            ("robot", "model"),
            f"the ground is at a height of {heights[0]:g} m, and episodes begin with the feet at 0: the robot begins "
            "in it or above it; move the ground to 0",
        )


def _actuators(robot: Robot) -> Iterator[Said]:
    """Actuators that do something else than the law of their drive in robot.toml."""
    if not robot.actions:
        return
    model, layout = robot.model, layout_of(robot)
    on = switched_on(model)
    for action, a, dof in zip(robot.file.actions, layout.action_actuator, layout.action_dof, strict=True):
        joint, odd = int(model.dof_jntid[dof]), []
        gear = float(model.actuator_gear[a, 0])
        if gear != 1.0:
            odd.append(f"has gear {gear:g}, by which MuJoCo multiplies what [[drives]] says: set it to 1")
        if model.actuator_actnum[a] and model.actuator_dyntype[a] not in FILTERS:
            odd.append(
                "has a state of its own, so it does not do what it is told at once: set dyntype to none"
            )
        if not on[a]:
            odd.append(
                "is switched off by actuatorgroupdisable, so it does nothing: take its group out of that option"
            )
        if model.actuator_history[a].any():
            odd.append(
                f"has a delay of {model.actuator_delay[a]:g} s, which dynreg leaves out: take it out of the model; in "
                "a simulator it is the effect command_delay"
            )
        own = np.isin(model.actuator_trntype, JOINT) & (model.actuator_trnid[:, 0] == joint)
        if own.sum() > 1:
            odd.append("is not the only one on its joint, and the others always get 0: keep one")
        for one in odd:
            yield ("actions", action.name, "name"), f"the actuator of action {action.name!r} {one}"


def _left_out(robot: Robot) -> Iterator[Said]:
    """What the joint engine, which moves each joint alone, leaves out of a driven joint."""
    if "joint" not in robot.engines or not robot.actions:
        return
    model, layout = robot.model, layout_of(robot)
    dofs, at = layout.action_dof, layout.action_actuator
    joints = model.dof_jntid[dofs]
    fluid = model.opt.density != 0.0 or model.opt.viscosity != 0.0
    told = {
        "springs (stiffness)": _some(joints, model.jnt_stiffness, model.jnt_stiffnesspoly),
        "damping that grows with speed": _some(dofs, model.dof_dampingpoly),
        "limits of the joint's force (actuatorfrcrange)": model.jnt_actfrclimited[joints] != 0,
        "filters of actuators": model.actuator_actnum[at] > 0,
        "damping of actuators": _some(at, model.actuator_damping, model.actuator_dampingpoly),
        "tendons": _on_tendons(model)[joints],
        "gravity compensation": np.full(len(dofs), bool(model.body_gravcomp.any())),
        "equality constraints": np.full(len(dofs), bool(model.eq_active0.any())),
        "drag of air or water (density, viscosity)": np.full(len(dofs), bool(fluid)),
    }
    told |= {
        f'the flag {name}="disable"': np.full(len(dofs), bool(model.opt.disableflags & bit))
        for name, bit in FLAGS.items()
    }
    lacks = [what for what, where in told.items() if where.any()]
    if lacks:
        yield (
            ("robot", "engines"),
            f"engine joint leaves out {', '.join(lacks)} of the model, and answers otherwise than mujoco; name mujoco "
            "alone in `engines`, or take them out of the model",
        )


def _some(rows: np.ndarray | slice, *fields: np.ndarray) -> np.ndarray:
    """(rows,) whether one of these fields of a model is anything but 0 there."""
    return np.column_stack([field[rows] for field in fields]).any(axis=1)


def _on_tendons(model: mujoco.MjModel) -> np.ndarray:
    """(joints,) at which a tendon pulls that is a spring, damps, rubs or has limits; a spatial one maybe at any."""
    names = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "limited")
    pulls = _some(slice(None), *(getattr(model, f"tendon_{name}") for name in names))
    out = np.zeros(model.njnt, dtype=bool)
    for first, many in zip(model.tendon_adr[pulls], model.tendon_num[pulls], strict=True):
        fixed = model.wrap_type[first : first + many] == mujoco.mjtWrap.mjWRAP_JOINT
        out[model.wrap_objid[first : first + many][fixed]] = True
        out |= not fixed.all()
    return out


def _bound_unseen(robot: Robot) -> Iterator[Said]:
    """Joints that a constraint binds to others, and that no channel tells: every episode begins with it violated."""
    model, layout = robot.model, layout_of(robot)
    seen = {*layout.position[1], *layout.action_qpos}
    free = [
        model.joint(j).name or f"joint {j}"
        for j in _bound(model)
        if int(model.jnt_type[j]) in SINGLE and model.jnt_qposadr[j] not in seen
    ]
    if free:
        yield (
            ("robot", "model"),
            f"equality constraints bind joints, and no channel tells {', '.join(free)}: an episode begins with these "
            "in the reset pose, and the constraint pulls at all of them; log them and add channels. The log may hold "
            'them under other names: see what its map lists as "Not used"',
        )


def _bound(model: mujoco.MjModel) -> list[int]:
    """Numbers of the joints that an active equality constraint binds: its own, or those that move its bodies."""
    out: set[int] = set()
    for e in np.flatnonzero(model.eq_active0):
        ends = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
            out.update(end for end in ends if end >= 0)
        elif model.eq_type[e] in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            sites = model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE
            for body in (int(model.site_bodyid[end]) if sites else end for end in ends):
                while body > 0:
                    first, many = int(model.body_jntadr[body]), int(model.body_jntnum[body])
                    out.update(range(first, first + many))
                    body = int(model.body_parentid[body])
    return sorted(out)

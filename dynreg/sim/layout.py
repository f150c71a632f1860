"""Where each channel and action of a robot lives in a MuJoCo state."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dynreg.data.attitude import euler_angles
from dynreg.data.names import parts_of
from dynreg.errors import RobotError, quoted
from dynreg.sim.beside import tracked_bodies
from dynreg.sim.held import scalar_joints
from dynreg.sim.robot import Robot

BASE = ("x", "y", "z", "roll", "pitch", "yaw", "vx", "vy", "vz", "wx", "wy", "wz")
PLACE = tuple(BASE.index(name) for name in ("x", "y", "yaw"))  # where on level ground the base is
TURN = 2.0 * np.pi  # rad
FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))  # what smooths a command


@dataclass(frozen=True)
class Layout:
    """Columns of the state vector in qpos, qvel and the base's motion; qpos, dof and actuator of each action.

    `position`, `velocity` and `base` are (channel columns, addresses or BASE indexes). `tracked` : where the positions
    of the bodies beside the robot begin in qpos.
    """

    position: tuple[np.ndarray, np.ndarray]
    velocity: tuple[np.ndarray, np.ndarray]
    base: tuple[np.ndarray, np.ndarray]
    base_qpos: int
    base_dof: int
    action_qpos: np.ndarray
    action_dof: np.ndarray
    action_actuator: np.ndarray
    action_range: np.ndarray
    tracked: np.ndarray


def layout_of(robot: Robot) -> Layout:
    """Resolve the robot's names against its model; RobotError when one is not there, or two actions move one joint.

    "<joint>/position" and "<joint>/velocity" are a hinge's or slide's; "<free joint>/roll" and the other
    names of BASE are the floating base's: position and Euler angles in the world, velocities in the body frame.
    """
    model = robot.model
    single = {model.joint(j).name: j for j in scalar_joints(model)}
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    joints = single | {model.joint(j).name: j for j in free}  # of a ball joint, no channel tells one number
    base = robot.base
    columns: dict[str, list[tuple[int, int]]] = {"position": [], "velocity": [], "base": []}
    for column, name in enumerate(robot.channels):
        owner, quantity = parts_of(name)
        joint = joints.get(owner)
        if joint is None:
            raise _unknown(f"channel {name!r}", list(joints))
        if joint in free and joint != base:
            raise _not_the_base(name, owner, model.joint(base).name if base >= 0 else None)
        if joint in free and quantity in BASE:
            columns["base"].append((column, BASE.index(quantity)))
        elif joint not in free and quantity == "position":
            columns["position"].append((column, int(model.jnt_qposadr[joint])))
        elif joint not in free and quantity == "velocity":
            columns["velocity"].append((column, int(model.jnt_dofadr[joint])))
        else:
            choices = BASE if joint in free else ("position", "velocity")
            raise _unknown(f"channel {name!r}", [f"{owner}/{q}" for q in choices])
    return Layout(
        *(tuple(np.array(pairs, dtype=int).reshape(-1, 2).T) for pairs in columns.values()),
        int(model.jnt_qposadr[base]) if base >= 0 else -1,
        int(model.jnt_dofadr[base]) if base >= 0 else -1,
        *_action_addresses(robot, single),
        model.jnt_qposadr[model.body_jntadr[tracked_bodies(robot)]].astype(int),
    )


def _action_addresses(robot: Robot, joints: dict[str, int]) -> tuple[np.ndarray, ...]:
    model = robot.model
    qpos, dof, actuator = [], [], []
    for i, (owner, action) in enumerate(zip(robot.joints, robot.actions, strict=True)):
        if owner not in joints:
            raise _unknown(f"action {action!r}", list(joints))
        first = robot.joints.index(owner)
        if first < i:
            raise _second(action, robot.actions[first], owner)
        joint = joints[owner]
        on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        driven = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint))
        if not len(driven):
            raise RobotError(
                f"action {action!r}: no actuator of the model moves joint {owner!r}",
                expected="a <general>, <motor> or <position> actuator on that joint",
                do="add one to the MJCF",
            )
        qpos.append(model.jnt_qposadr[joint])
        dof.append(model.jnt_dofadr[joint])
        actuator.append(driven[0])
    return *(np.array(items, dtype=int) for items in (qpos, dof, actuator)), robot.action_ranges


def filters(model: mujoco.MjModel, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the drives (F,) whose actuators smooth their commands, and where in `act` (F,) what they hold is."""
    at = layout.action_actuator
    drives = np.flatnonzero(np.isin(model.actuator_dyntype[at], FILTERS))
    return drives, model.actuator_actadr[at[drives]] + model.actuator_actnum[at[drives]] - 1


def observe(layout: Layout, qpos: np.ndarray, qvel: np.ndarray, channels: int) -> np.ndarray:
    """State vectors (..., S) of MuJoCo states (..., nq), (..., nv)."""
    states = np.empty(qpos.shape[:-1] + (channels,))
    for (columns, addresses), source in ((layout.position, qpos), (layout.velocity, qvel)):
        states[..., columns] = source[..., addresses]
    columns, which = layout.base
    if len(columns):
        states[..., columns] = base_motion(layout, qpos, qvel)[..., which]
    return states


def headed(layout: Layout, states: np.ndarray, first: np.ndarray | None) -> None:
    """Let the base's heading in states (n, T+1, S) go on beyond half a turn, as in a log, in place.

    first : (n, S) measured states that they begin with, which tell the turn; None for that around 0.
    """
    columns = layout.base[0][layout.base[1] == BASE.index("yaw")]
    if not len(columns):
        return
    yaw = states[..., columns]
    before = np.zeros_like(yaw[:, :1]) if first is None else np.nan_to_num(first[:, None, columns])
    with np.errstate(invalid="ignore", over="ignore"):  # of a simulation that diverged
        states[..., columns] = continued(np.concatenate([before, yaw], axis=1), axis=1)[:, 1:]


def continued(angle: np.ndarray, axis: int) -> np.ndarray:
    """Angles [rad] of a base that go on beyond half a turn along `axis`: jumps by three quarters or more are wraps.

    A base that pitches through the vertical shows half a turn from one row to the next, and soon shows it back: this
    stays as it is. Taken for a whole turn, it would stay in all rows after it.
    """
    turns = np.round((np.unwrap(angle, discont=0.75 * TURN, axis=axis) - angle) / TURN)
    return angle + TURN * turns  # of whole turns alone: rows that are told one by one are the same


def base_motion(layout: Layout, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """(..., 12) the floating base in the order of BASE [m, rad, m/s, rad/s]."""
    at, dof = layout.base_qpos, layout.base_dof
    quaternion = qpos[..., at + 3 : at + 7]
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rotation = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )
    linear = np.einsum("...ij,...i->...j", rotation, qvel[..., dof : dof + 3])
    angles = np.stack(euler_angles(w, x, y, z), -1)
    return np.concatenate([qpos[..., at : at + 3], angles, linear, qvel[..., dof + 3 : dof + 6]], -1)


def start_place(robot: Robot, layout: Layout) -> np.ndarray:
    """(3,) x and y [m] and yaw [rad] of a floating base where episodes start: as the keyframe has it; 0 without one."""
    if layout.base_qpos < 0:
        return np.zeros(3)
    return base_motion(layout, robot.start, np.zeros(robot.model.nv))[list(PLACE)]


def place(layout: Layout, states: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
    """Write known joint channels (n, S; NaN = leave) into MuJoCo states (n, nq), (n, nv), in place.

    The base keeps the pose and height of the reset; `place_base` writes those of a log that knows them.
    """
    for (columns, addresses), target in ((layout.position, qpos), (layout.velocity, qvel)):
        known = states[:, columns]
        target[:, addresses] = np.where(np.isnan(known), target[:, addresses], known)


def place_base(layout: Layout, states: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Write a floating base's measured motion (n, S; NaN = unknown) into MuJoCo states (n, nq), (n, nv), in place.

    The inverse of `base_motion`. Bases whose roll or pitch is unknown stay as they are. Unknown velocities are 0, an
    unknown heading is 0, an unknown position stays. Returns (n,) whether the base was placed without a known height.
    """
    from scipy.spatial.transform import Rotation  # a third of what a check has to import

    known = np.full((len(states), len(BASE)), np.nan)
    known[:, layout.base[1]] = states[:, layout.base[0]]
    tilted = np.isfinite(known[:, 3:5]).all(axis=1)
    at, dof = layout.base_qpos, layout.base_dof
    where = np.where(np.isfinite(known[:, :3]), known[:, :3], qpos[:, at : at + 3])
    known = np.nan_to_num(known)
    rotation = Rotation.from_euler("ZYX", known[:, [5, 4, 3]])
    quaternion = rotation.as_quat(scalar_first=True)
    linear = rotation.apply(known[:, 6:9])
    for target, first, values in (
        (qpos, at, where),
        (qpos, at + 3, quaternion),
        (qvel, dof, linear),
        (qvel, dof + 3, known[:, 9:12]),
    ):
        columns = slice(first, first + values.shape[1])
        target[:, columns] = np.where(tilted[:, None], values, target[:, columns])
    height = layout.base[0][layout.base[1] == BASE.index("z")]
    return tilted & ~np.isfinite(states[:, height]).any(axis=1)


def _not_the_base(channel: str, joint: str, base: str | None) -> RobotError:
    return RobotError(
        f"channel {channel!r}: the free joint {joint!r} carries no joint that is driven",
        expected=f"the robot's base, {base!r}" if base else "joints of the robot, whose base is held",
        do="correct the channel, or name the body under `tracked` of [robot]",
    )


def _second(action: str, first: str, joint: str) -> RobotError:
    return RobotError(
        f"action {action!r}: joint {joint!r} already has the action {first!r}",
        expected="one action for each joint: the command of its one drive",
        do=f"keep one of {first!r} and {action!r}, with its drive",
    )


def _unknown(what: str, choices: list[str]) -> RobotError:
    return RobotError(
        f"{what} is not in the model",
        expected=f"one of {quoted(choices)}",
        do="correct robot.toml or the MJCF",
    )

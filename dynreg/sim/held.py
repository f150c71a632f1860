"""Facts of a MuJoCo model: a keyframe's pose, which actuators act, and which joints something else holds."""

import mujoco
import numpy as np

SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))  # of actuators on joints


def scalar_joints(model: mujoco.MjModel) -> list[int]:
    """Numbers of the hinges and slides."""
    return [j for j in range(model.njnt) if int(model.jnt_type[j]) in SINGLE]


def pose_of(model: mujoco.MjModel, key: int) -> np.ndarray:
    """(nq,) the pose of a keyframe, by its number; below 0 the model's own."""
    return np.array(model.qpos0 if key < 0 else model.key_qpos[key])


def switched_on(model: mujoco.MjModel) -> np.ndarray:
    """(nu,) which actuators act: those of a group that `actuatorgroupdisable` names do not. Such groups are 0 to 30."""
    group = model.actuator_group
    named = np.right_shift(model.opt.disableactuator, np.clip(group, 0, 30)) & 1
    return (named == 0) | (group < 0) | (group > 30)


def held_joints(model: mujoco.MjModel) -> set[int]:
    """Numbers of the joints that an actuator, a tendon or an equality constraint holds, whether or not it is driven."""
    on = [model.actuator_trnid[a, 0] for a in range(model.nu) if int(model.actuator_trntype[a]) in JOINT]
    equal = model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    on += [*model.eq_obj1id[equal], *model.eq_obj2id[equal]]
    on += [*model.wrap_objid[model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT]]
    return {int(joint) for joint in on}


def loose_joints(model: mujoco.MjModel) -> list[int]:
    """Numbers of the hinges and slides that nothing of the model moves but their own motion."""
    held = held_joints(model)
    return [j for j in scalar_joints(model) if j not in held]


def tied(model: mujoco.MjModel, joints: set[int]) -> set[int]:
    """Numbers of these joints, and of those that an equality ties to one of them, as a mimic finger to a driven one."""
    pairs = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1)[
        model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    ].tolist()
    out = set(joints)
    for _ in pairs:  # no chain is longer than all of them
        out.update(j for pair in pairs if not out.isdisjoint(pair) for j in pair if j >= 0)
    return out

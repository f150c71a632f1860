"""Joints that something else moves than their own motion: an actuator, a tendon or an equality constraint."""

import mujoco

JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))  # of actuators on joints


def held_joints(model: mujoco.MjModel) -> set[int]:
    """Numbers of the joints that an actuator, a tendon or an equality constraint holds, whether or not it is driven."""
    on = [model.actuator_trnid[a, 0] for a in range(model.nu) if int(model.actuator_trntype[a]) in JOINT]
    equal = model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    on += [*model.eq_obj1id[equal], *model.eq_obj2id[equal]]
    on += [*model.wrap_objid[model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT]]
    return {int(joint) for joint in on}

"""The actuators of a drafted model: one for each of its drives."""

from itertools import count

import mujoco
import numpy as np

from dynreg.draft.drives import Drive, name_of
from dynreg.draft.opened import Opened, free_name
from dynreg.sim.held import JOINT


def put_drives(opened: Opened, drives: tuple[Drive, ...]) -> None:
    """Give the model one actuator for each drive, which does what robot.toml says of it, instead of those on its joint.

    Damping and armature of the actuators that go become their joints' own. A joint's limit of force, alike both ways,
    becomes its drive's: a parameter can then raise it. All other actuators stay and get no command: what a servo on a
    tendon holds, such as a gripper, would fall loose without it.
    """
    spec, model = opened.spec, opened.compiled()
    by_joint, early = {d.joint: d for d in drives}, set()
    for a, actuator in enumerate(list(spec.actuators)):
        joint = int(model.actuator_trnid[a, 0])
        own = model.actuator_trntype[a] in JOINT and name_of(model, joint) in by_joint
        if own:
            gear = float(model.actuator_gear[a, 0]) ** 2
            it = next(j for j in spec.joints if j.name == name_of(model, joint))
            it.damping[0] += gear * float(model.actuator_damping[a])
            it.armature += gear * float(model.actuator_armature[a])
            early |= {it.name} if actuator.actearly else set()
            spec.delete(actuator)
    for kept in [a for a in spec.actuators if a.name in by_joint]:
        kept.name = free_name(kept.name, spec.actuators)
    on = next(group for group in count() if not spec.option.disableactuator >> group & 1)
    for drive in drives:
        made = spec.add_actuator(
            name=drive.joint, target=drive.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, group=on
        )
        made.gaintype, made.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        gain, bias = _law(drive)
        made.gainprm[0] = gain
        made.biasprm[:3] = bias
        if drive.lag:
            made.dyntype, made.dynprm[0], made.actdim = mujoco.mjtDyn.mjDYN_FILTEREXACT, drive.lag, 1
            made.actearly = drive.joint in early
            if drive.holds is not None:
                made.actlimited, made.actrange = 1, drive.holds
        if drive.low is not None and drive.high is not None and not drive.usual:
            made.ctrllimited, made.ctrlrange = 1, [drive.low, drive.high]
        if drive.limit is not None:
            made.forcelimited, made.forcerange = 1, [-drive.limit, drive.limit]
            joint = model.joint(drive.joint).id
            if np.sum(model.jnt_actfrcrange[joint]) == 0.0 and not model.jnt_actgravcomp[joint]:
                next(j for j in spec.joints if j.name == drive.joint).actfrclimited = 0
    for key in spec.keys:
        key.ctrl, key.act = [], []


def _law(drive: Drive) -> tuple[float, list[float]]:
    if drive.kind == "position":
        return drive.gain, [0.0, -drive.gain, -drive.rate_gain]
    if drive.kind == "velocity":
        return drive.rate_gain, [0.0, 0.0, -drive.rate_gain]
    if drive.kind == "dcmotor":
        return drive.kt / drive.resistance, [0.0, 0.0, -(drive.kt**2) / drive.resistance]
    return drive.gain, [0.0, 0.0, 0.0]

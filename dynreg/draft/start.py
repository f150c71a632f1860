"""The pose that episodes begin from, where the model has no keyframe: that of the log, within the joints' stops."""

import numpy as np

from dynreg.draft.drives import name_of
from dynreg.draft.heard import Heard
from dynreg.draft.opened import Opened
from dynreg.draft.tables import keyframe_of
from dynreg.sim.held import scalar_joints

START = "start"


def add_start(opened: Opened, base: int, told: Heard | None) -> None:
    """Add a keyframe where the model has none and its own pose is not that of the log, or beyond a joint's stops.

    Joints of which the log tells nothing stay, or go to the middle between their stops.
    """
    model = opened.compiled()
    if keyframe_of(model) >= 0:
        return
    pose = model.qpos0.copy()
    for joint in scalar_joints(model):
        at = model.jnt_qposadr[joint]
        first = told.first(f"{name_of(model, joint)}/position") if told else None
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
        if first is not None and low <= first <= high:
            pose[at] = first
        elif not low <= pose[at] <= high:
            pose[at] = (low + high) / 2
    if not np.array_equal(pose, model.qpos0):
        opened.spec.add_key(name=START, qpos=pose)

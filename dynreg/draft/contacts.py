"""Contacts of a robot with itself: taken out where they never happen, for they cost most of a simulation."""

import mujoco
import numpy as np

from dynreg.draft.entry import Notes
from dynreg.draft.opened import Opened
from dynreg.rng import stream
from dynreg.sim.held import JOINT, scalar_joints

POSES = 100  # that are tried
MIDDLE, WHOLE = (
    0.6,
    1.0,
)  # shares of the joints' ranges that they lie in: at the stops of many arms links do meet
FREE, TURN = (
    1.0,
    np.pi,
)  # rad or m, half the range of joints without stops: of commands, and of all they can reach
RARE = 0.03  # share of them that may touch: commands seldom lead there


def without_self_contacts(opened: Opened, base: int, notes: Notes) -> None:
    """Let the links of a robot without a free base pass through each other where they hardly ever meet.

    Only where nothing of the scene is within their reach, and nothing moves that no drive moves: it lies on something.
    """
    model = opened.compiled()
    geoms = np.flatnonzero((model.geom_contype > 0) | (model.geom_conaffinity > 0))
    bodies = model.geom_bodyid[geoms]
    driven = model.body_rootid[model.jnt_bodyid[model.actuator_trnid[_on_joints(model), 0]]]
    own, moves = np.isin(model.body_rootid[bodies], driven), model.body_weldid[bodies] > 0
    freely = (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any()
    if base >= 0 or freely or not moves.any() or (moves & ~own).any():
        return
    if _share_touching(model, geoms, MIDDLE, FREE) > RARE:
        return
    if not own.all() and _share_touching(model, geoms[~own], WHOLE, TURN) > 0:
        return
    for geom in opened.spec.geoms:
        geom.contype = geom.conaffinity = 0
    if len(np.unique(bodies)) > 1:
        notes.add("contacts between links are off: in the middle of the joints' ranges no links touch")


def _on_joints(model: mujoco.MjModel) -> np.ndarray:
    return np.isin(model.actuator_trntype, JOINT)


def _share_touching(model: mujoco.MjModel, geoms: np.ndarray, middle: float, free: float) -> float:
    """Share of random poses in which one of the geoms is in contact.

    middle : the share of the joints' ranges, about their middles, in which poses lie. free : half the range [rad or m]
    of joints that have none.
    """
    rng, data = stream(0, "draft", "contacts"), mujoco.MjData(model)
    met = 0
    for _ in range(POSES):
        data.qpos[:] = model.qpos0
        for joint in scalar_joints(model):
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-free, free)
            centre, half = (low + high) / 2, middle * (high - low) / 2
            data.qpos[model.jnt_qposadr[joint]] = rng.uniform(centre - half, centre + half)
        mujoco.mj_forward(model, data)
        met += bool(np.isin(data.contact.geom, geoms).any())
    return met / POSES

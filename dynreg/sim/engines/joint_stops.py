"""The stops of joints for the joint engine: those of the MuJoCo model, each for one joint that moves alone."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from dynreg.sim.fields import own_field
from dynreg.sim.layout import Layout

_LEAST, _MOST = mujoco.mjMINIMP, mujoco.mjMAXIMP  # between which MuJoCo keeps impedances


def stop_rows(batch: Batch, model: mujoco.MjModel, layout: Layout, h: np.ndarray) -> dict[str, np.ndarray]:
    """{row of `joint_kernel`: (n, A)} of stops in simulations with time steps h (n,) [s].

    A joint between LOW and HIGH [rad or m] feels nothing. Beyond, its stop asks for the acceleration
    -DAMPER v - share SPRING depth, and the joint's own becomes that, by a share that grows from SOFTEST to FIRMEST
    within DEPTH. It is MuJoCo's constraint of one joint (its documentation, "Computation", solref and solimp), exact
    where the joint's inertia is that of its model at rest.
    """
    joints = model.dof_jntid[layout.action_dof]
    ranges, reference, impedance, margin = (
        own_field(batch, model, name)[:, joints]
        for name in ("jnt_range", "jnt_solref", "jnt_solimp", "jnt_margin")
    )
    free = model.jnt_limited[joints] == 0
    soft, firm = (np.clip(impedance[..., i], _LEAST, _MOST) for i in (0, 1))
    spring, damper = _reference(model, reference, firm, h[:, None])
    rows = {
        "LOW": np.where(free, -np.inf, ranges[..., 0] + margin),
        "HIGH": np.where(free, np.inf, ranges[..., 1] - margin),
        "SPRING": spring,
        "DAMPER": damper,
        "FIRMEST": firm,
        "SOFTEST": soft,
        "DEPTH": np.maximum(impedance[..., 2], mujoco.mjMINVAL),
        "MIDDLE": np.clip(impedance[..., 3], _LEAST, _MOST),
        "POWER": np.maximum(impedance[..., 4], 1.0),
    }
    return {name: np.broadcast_to(row, (batch.nsim, len(joints))) for name, row in rows.items()}


def _reference(
    model: mujoco.MjModel, reference: np.ndarray, firm: np.ndarray, h: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness [1/s^2] and damping [1/s] of stops, from a time constant and damping ratio, or negative as they are."""
    first, second = reference[..., 0], reference[..., 1]
    safe = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE
    time = np.maximum(first, 2.0 * h) if safe else first
    time, ratio = np.maximum(time, mujoco.mjMINVAL), np.maximum(second, mujoco.mjMINVAL)
    spring = np.where(first > 0, 1.0 / (firm * time * ratio) ** 2, -first / firm**2)
    return spring, np.where(first > 0, 2.0 / (firm * time), -second / firm)

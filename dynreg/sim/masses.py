"""Masses fixed to bodies of a MuJoCo model: at a site with the site's shape, or spread as the body itself is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dynreg.errors import RobotError, quoted

Expand = Callable[[str], np.ndarray]  # field of MjModel of all simulators (B, ...), to be changed in place


@dataclass(frozen=True)
class Weight:
    """A kilogram fixed to a body.

    body : its number. centre : (3,) of the weight [m] in the body's frame. spread : (3, 3) its inertia about that
    centre [kg*m^2], along the axes of the body's frame.
    """

    body: int
    centre: np.ndarray
    spread: np.ndarray

    def add(self, expand: Expand, rows: Any, mass: np.ndarray) -> None:
        """Fix so many kilograms (n,) to the body of each of these simulators, by the parallel-axis theorem.

        Raises RobotError where less than nothing would be left of the body.
        """
        body, mass = self.body, np.asarray(mass, dtype=float)
        arrays = [expand(f"body_{name}") for name in ("mass", "ipos", "iquat", "inertia")]
        own, at, turn, inertia = (a[rows, body].copy() for a in arrays)
        whole = own + mass
        if not (whole > 0).all():
            raise RobotError(
                f"a mass of {whole.min():g} kg would be left of a body",
                expected="a mass above 0",
                do="take less away from it",
            )
        centre = (own[:, None] * at + mass[:, None] * self.centre) / whole[:, None]
        axes = _rotations(turn)
        total = axes * inertia[:, None, :] @ axes.transpose(0, 2, 1) + mass[:, None, None] * self.spread
        total += _about(at - centre, own) + _about(self.centre - centre, mass)
        principal, axes = np.linalg.eigh(total)
        if not (principal > 0).all():
            raise RobotError(
                f"an inertia of {principal.min():g} kg*m^2 would be left of a body",
                expected="an inertia above 0",
                do="take less away from it",
            )
        axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
        changed = mass != 0.0  # who carries nothing stays the plain model, to the bit
        for array, new in zip(arrays, (whole, centre, _quaternions(axes), principal), strict=True):
            old = array[rows, body]
            array[rows, body] = np.where(changed.reshape(-1, *[1] * (old.ndim - 1)), new, old)


def weight_at(model: mujoco.MjModel, name: str) -> Weight:
    """A weight at a site, as large and of the shape that the site has there; RobotError without one of that name."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site < 0 or model.site_bodyid[site] == 0:
        raise RobotError(
            f"no site {name!r} on a body that moves",
            expected=f"one of {quoted(moving_sites(model))}",
            do="add a <site> to the body in the MJCF, or correct the name",
        )
    (axes,) = _rotations(model.site_quat[site][None])
    shape = np.diag(_spread(int(model.site_type[site]), model.site_size[site]))
    return Weight(int(model.site_bodyid[site]), model.site_pos[site].copy(), axes @ shape @ axes.T)


def moving_sites(model: mujoco.MjModel) -> list[str]:
    """Names of the sites of bodies that are not the world."""
    return [model.site(i).name for i in range(model.nsite) if model.site_bodyid[i] and model.site(i).name]


def grow(expand: Expand, model: mujoco.MjModel, rows: Any, body: int, mass: Any) -> None:
    """Add mass (n, 1) to a body about its own centre, spread as the model's body is."""
    expand("body_mass")[rows, body] += mass[:, 0]
    per_kg = model.body_inertia[body] / max(model.body_mass[body], mujoco.mjMINVAL)
    expand("body_inertia")[rows, body] += mass * per_kg


def _spread(kind: int, size: np.ndarray) -> np.ndarray:
    """(3,) moments of inertia of a uniform kilogram of a site's type and size [m^2], as of MuJoCo's geoms."""
    a, b, c = size**2
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(3, 2 / 5 * a)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return np.array([b + c, a + c, a + b]) / 5
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.array([b + c, a + c, a + b]) / 3
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return np.array([a / 4 + b / 3, a / 4 + b / 3, a / 2])
    radius, half = size[:2]  # a capsule: a cylinder and two half spheres
    ends = 4 / 3 * radius / (2 * half + 4 / 3 * radius)
    round_part = 2 / 5 * a + half**2 + 3 / 4 * radius * half  # about the capsule's centre
    across = (1 - ends) * (a / 4 + b / 3) + ends * round_part
    return np.array([across, across, (1 - ends) * a / 2 + ends * 2 / 5 * a])


def _about(offset: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inertia of point masses (n,) at offsets (n, 3) from an axis."""
    square = np.sum(offset**2, axis=1)[:, None, None] * np.eye(3)
    return mass[:, None, None] * (square - offset[:, :, None] * offset[:, None, :])


def _rotations(quaternions: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotation matrices of unit quaternions (n, 4)."""
    out = np.empty((len(quaternions), 9))
    for one, quaternion in zip(out, quaternions, strict=True):
        mujoco.mju_quat2Mat(one, quaternion)
    return out.reshape(-1, 3, 3)


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """(n, 4) unit quaternions of rotation matrices (n, 3, 3)."""
    out = np.empty((len(rotations), 4))
    for one, rotation in zip(out, rotations, strict=True):
        mujoco.mju_mat2Quat(one, np.ascontiguousarray(rotation).reshape(9))
    return out

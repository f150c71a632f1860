"""What a robot with a free base stands on, and with what."""

from dataclasses import dataclass

import mujoco
import numpy as np

from dynreg.draft.entry import Notes
from dynreg.draft.opened import Opened, free_name
from dynreg.sim.engines.mujoco_reset import lowest, scenery, touching

NEAR = 0.03  # m above the lowest point of a robot in which its feet are
GRAVITY = 9.81  # m/s^2
REACH = 50.0  # m, half the side of a ground that is added


@dataclass(frozen=True)
class Ground:
    """Names of the geoms of the scene that a robot can stand on, of those that touch it first, and their friction.

    friction : None where contacts have none.
    """

    scene: tuple[str, ...]
    feet: tuple[str, ...]
    friction: float | None


def add_ground(opened: Opened, base: int, notes: Notes) -> None:
    """Put a plane under a robot with a free base where the model has nothing that it could stand on."""
    model = opened.compiled()
    own = touching(model, int(model.jnt_bodyid[base])) if base >= 0 else np.zeros(0, dtype=int)
    if base < 0 or len(scenery(model, own)):
        return
    name = free_name("ground", opened.spec.geoms)
    plane = opened.spec.worldbody.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[REACH, REACH, 0.1]
    )
    plane.contype = int(np.bitwise_or.reduce(model.geom_conaffinity[own], initial=0)) or 1
    plane.conaffinity = int(np.bitwise_or.reduce(model.geom_contype[own], initial=0)) or 1
    notes.add(
        f"the model has nothing to stand on: it gets a plane called {name}, with MuJoCo's usual friction and softness"
    )
    if not model.opt.gravity.any():
        opened.spec.option.gravity = [0.0, 0.0, -GRAVITY]
        notes.add(f"the model has no gravity: it gets {GRAVITY} m/s^2, as it stands on the ground")


def ground_of(model: mujoco.MjModel, base: int, qpos: np.ndarray) -> Ground | None:
    """What the robot on the free joint `base` touches first from the pose `qpos`; None where it touches nothing."""
    own = touching(model, int(model.jnt_bodyid[base]))
    scene = scenery(model, own)
    if not len(own) or not len(scene):
        return None
    low = _heights(model, qpos, own)
    feet = own[low <= low.min() + NEAR]
    pairs = [(int(s), int(f)) for s in scene for f in feet]
    found = {_of_contact(model, model.geom_friction[:, 0], *pair) for pair in pairs}
    rubs = len(found) == 1 and all(_of_contact(model, model.geom_condim, *pair) > 1 for pair in pairs)
    names = lambda geoms: tuple(model.geom(int(g)).name for g in geoms)  # noqa: E731
    return Ground(names(scene), names(feet), found.pop() if rubs else None)


def standing_height(model: mujoco.MjModel, base: int, qpos: np.ndarray) -> float:
    """Height of the base [m] where the robot's lowest point touches the ground, in the pose `qpos`."""
    low = _heights(model, qpos, touching(model, int(model.jnt_bodyid[base])))
    return float(qpos[model.jnt_qposadr[base] + 2]) - float(low.min() if len(low) else 0.0)


def _heights(model: mujoco.MjModel, qpos: np.ndarray, geoms: np.ndarray) -> np.ndarray:
    """The height [m] of the lowest point of each geom in a pose."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    sizes, centres, turned = model.geom_size, data.geom_xpos, data.geom_xmat
    return np.array([lowest(model, g, sizes[[g]], centres[[g]], turned[[g]])[0] for g in geoms])


def _of_contact(model: mujoco.MjModel, field: np.ndarray, one: int, other: int) -> float:
    """What two geoms in contact have of a field (ngeom,): that of the one with priority, else the larger."""
    first, second = model.geom_priority[one], model.geom_priority[other]
    if first != second:
        return float(field[one if first > second else other])
    return float(max(field[one], field[other]))
